"""The NaVARo as a frame of beams, by the coordinates of its points (Briot, section 4)."""

import numpy as np

from peers.frame import Frame

E, NU, RHO = 74e9, 0.33, 2800.0
MATERIAL = (E, E / (2 * (1 + NU)), RHO)
# A, I_y, I_z, I_0, I_p
BAR = (2.4e-4, 1.152e-8, 2.0e-9, 5.902e-9, 1.352e-8, *MATERIAL)
PLATE = (4e-4, 3.333e-9, 5.333e-8, 1.123e-8, 5.6663e-8, *MATERIAL)
GROUND, BAR_LENGTH, SPOKE = 0.7 / np.sqrt(3), 0.21, 0.2027


def navaro_frame(x, y, theta):
    """Return the Frame at a pose of the platform, with 90 displacements."""
    frame = Frame()
    P = np.array([x, y, 0.0])
    centre = frame.node(P)
    for gamma in (np.pi / 2, -5 * np.pi / 6, -np.pi / 6):
        A = GROUND * _direction(gamma)
        E_i = P + SPOKE * _direction(gamma + theta)
        reach = E_i - A
        phi, beta = np.arctan2(reach[1], reach[0]), np.arccos(np.linalg.norm(reach) / (2 * BAR_LENGTH))
        u1, u4 = _direction(phi + beta), _direction(phi - beta)
        ground = frame.node(A, clamped=True)
        d = frame.node(A + BAR_LENGTH * u1)
        b = frame.node(A - BAR_LENGTH * u4)
        c = frame.node(A - BAR_LENGTH * u4 + BAR_LENGTH * u1)
        e = frame.node(E_i)
        frame.beam(ground, d, BAR)
        frame.beam(ground, b, BAR)
        frame.beam(frame.hinge(b), c, BAR)
        elbow = frame.hinge(c)
        middle = frame.hinge(d)
        frame.beam(elbow, middle, BAR)
        frame.beam(middle, e, BAR)
        frame.beam(frame.hinge(e), centre, PLATE)
    return frame


def _direction(angle):
    return np.array([np.cos(angle), np.sin(angle), 0.0])
