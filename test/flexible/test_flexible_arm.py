"""Inverse and direct dynamics of arms with flexible links: rigid and elastic motion together."""

import numpy as np
import pytest
from peers.bending_chain import BendingChain
from peers.frame import Frame
from scipy.integrate import solve_ivp
from scipy.linalg import eigvalsh

from robot_dynamics import Dynamics, InvalidInputError, SingularModelError, load_robot
from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw

THICK, THIN = [4e-4, 5e-8, 2e-8, 3e-8, 7e-8], [2e-4, 1e-8, 8e-9, 9e-9, 1.8e-8]
ARM = """
robot: arm
gravity: {gravity}
materials: {{alloy: {{youngs_modulus: {youngs}, poissons_ratio: 0.3, density: 2700}}}}
sections:
  thick: {{area: 4e-4, second_moment_y: 5e-8, second_moment_z: 2e-8, torsion_constant: 3e-8, polar_moment: 7e-8}}
  thin: {{area: 2e-4, second_moment_y: 1e-8, second_moment_z: 8e-9, torsion_constant: 9e-9, polar_moment: 1.8e-8}}
joints:
  - joint: shoulder
    link: upper
    mdh: {{alpha: 0.3}}{shoulder}
    beams: [{{to: [0.5, 0, 0], section: thick, material: alloy, elements: {elements}}}]
  - joint: elbow
    link: fore
    mdh: {{d: 0.5, alpha: pi/2}}{elbow}
    beams: [{{to: [0.4, 0, 0], section: thin, material: alloy}}]
  - {{type: fixed, link: tool, antecedent: fore, mdh: {{d: 0.4}}, mass: {tool}}}
"""


def arm(elements=2, youngs=70e9, gravity=(0, 0, -9.81), shoulder="", elbow="", tool=0.3):
    text = ARM.format(
        elements=elements, youngs=youngs, gravity=list(gravity), shoulder=shoulder, elbow=elbow, tool=tool
    )
    return Dynamics(load_robot(text))


def states(flexible, count=4, seed=1, loads=20.0):
    """Return q, qd, e, ed of motions; e is the bending by forces of some newtons and newton-metres."""
    rng = np.random.default_rng(seed)
    n, m = len(flexible.joint_names), len(flexible.elastic_coordinate_names)
    e = np.linalg.solve(flexible.stiffness, rng.normal(0, loads, (m, count)) * 0.2).T
    return rng.normal(0, 1, (count, n)), rng.normal(0, 2, (count, n)), e, 30 * e[::-1]


def steady_bending(flexible, q, qd, wrenches=None):
    """Return e (m,) of steady bending at constant joint velocities, by Newton's method. wrenches: function of e."""
    m, zero = len(flexible.elastic_coordinate_names), np.zeros(len(flexible.elastic_coordinate_names))
    K, qdd, e = flexible.stiffness, np.zeros_like(qd), np.zeros(m)

    def excess(e):
        external_wrenches = None if wrenches is None else wrenches(e)
        return flexible.inverse(q, qd, qdd, e, zero, external_wrenches=external_wrenches).elastic_accelerations

    widths = 1e-6 / np.sqrt(np.diagonal(K) / np.diagonal(K).max())
    for _ in range(40):
        residual = excess(e)
        slope = (excess(e + np.diag(widths)) - excess(e - np.diag(widths))) / (2 * widths[:, None])
        step = np.linalg.solve(slope.T, residual)
        e = e - step / max(1.0, np.abs(step).max() / 0.1)
        if np.abs(step).max() < 1e-9:
            return e
    raise AssertionError("Newton's method does not converge")


def tilted(alpha):
    return placement(rotation_from_roll_pitch_yaw(alpha, 0, 0))


def chain(elements=2, youngs=70e9, gravity=(0, 0, -9.81), tool=0.3):
    material = [youngs, youngs / 2.6, 2700.0]
    links = [
        (tilted(0.3), [(0.5 / elements, THICK + material)] * elements, 0.0),
        (tilted(np.pi / 2), [(0.4, THIN + material)], tool),
    ]
    return BendingChain(links, gravity)


PASSIVE = "\n    role: passive"
SPRUNG = "\n    role: elastic\n    spring: {stiffness: 30, rest: 0.2, damping: 0.1}"
RUBBED = "\n    rotor_inertia: 0.05\n    viscous_friction: 0.3\n    coulomb_friction: 0.2"


@pytest.mark.parametrize("roles", [{}, {"elbow": PASSIVE}, {"shoulder": RUBBED, "elbow": SPRUNG}])
def test_direct_model_inverts_the_inverse_model(roles):
    dynamics = arm(**roles)
    flexible, actuated = dynamics.flexible_arm, ~np.isin(dynamics.joint_names, dynamics.unactuated_joint_names)
    q, qd, e, ed = states(flexible)
    qdd = np.where(actuated, np.random.default_rng(3).normal(0, 3, q.shape), 0)
    inverse = flexible.inverse(q, qd, qdd, e, ed)
    direct = flexible.direct(q, qd, inverse.efforts, e, ed)
    assert np.abs((inverse.accelerations - qdd)[:, actuated]).max() == 0
    assert not actuated.all() or np.abs(inverse.efforts).min() > 0
    scale = np.abs(inverse.elastic_accelerations).max()
    assert np.abs(direct.accelerations - inverse.accelerations).max() < 1e-9 * np.abs(inverse.accelerations).max()
    assert np.abs(direct.elastic_accelerations - inverse.elastic_accelerations).max() < 1e-9 * scale
    sample = flexible.direct(q[2], qd[2], inverse.efforts[2], e[2], ed[2])
    assert sample.accelerations == pytest.approx(direct.accelerations[2], rel=1e-8)


def test_efforts_agree_with_lagrange_equations_by_differences():
    """Efforts of any motion, M(q, e) [q̈; ë] + h, agree with those from the energies of an independent chain. The direct
    model without efforts gives h = -M [q̈; ë]."""
    flexible, peer = arm(youngs=7e7).flexible_arm, chain(youngs=7e7)
    q, qd, e, ed = states(flexible, count=1, loads=0.2)
    e[..., ::6] = 1e-3
    free = flexible.direct(q, qd, 0 * q, e, ed)
    prescribed = np.random.default_rng(5).normal(0, 3, (1, peer.size))
    M = flexible.inertia_matrix(q, e)[0]
    actual = M @ (prescribed - np.concatenate([free.accelerations, free.elastic_accelerations], axis=1))[0]
    x, rates = np.concatenate([q, e], axis=1)[0], np.concatenate([qd, ed], axis=1)[0]
    assert np.abs(e).max() > 0.01 and np.abs(ed).max() > 0.3
    rows = [0, 1, 4, 6, 9, 15, 17]
    expected = peer.efforts(x, rates, prescribed[0], rows)
    assert np.abs(actual[rows] - expected).max() < 1e-8 * np.abs(expected).max()
    assert rates @ M @ rates / 2 == pytest.approx(peer.kinetic(x, rates), rel=1e-9)


def test_energy_of_a_free_arm_is_conserved():
    """A soft arm falls freely, without efforts and friction."""
    flexible, peer = arm(elements=1, youngs=2e6).flexible_arm, chain(elements=1, youngs=2e6)
    n = len(flexible.joint_names)

    def derivative(_, y):
        x, rates = np.split(y, 2)
        result = flexible.direct(x[:n], rates[:n], np.zeros(n), x[n:], rates[n:])
        return np.concatenate([rates, result.accelerations, result.elastic_accelerations])

    start = np.zeros(2 * peer.size)
    start[:2], start[peer.size : peer.size + 2] = (0.3, -0.5), (6.0, -8.0)
    run = solve_ivp(derivative, (0, 0.06), start, method="DOP853", rtol=1e-8, atol=1e-8)
    strain, energies = [], []
    for y in run.y[:, :: max(1, run.y.shape[1] // 5)].T:
        x, rates = np.split(y, 2)
        strain.append(x[n:] @ flexible.stiffness @ x[n:] / 2)
        energies.append(peer.kinetic(x, rates) + peer.potential(x))
    assert max(strain) > 0.02 * peer.kinetic(*np.split(start, 2))
    assert np.ptp(energies) < 1e-7 * max(strain)


def test_stiff_beams_agree_with_rigid_links():
    """The difference falls with the stiffness."""
    differences = []
    for youngs in (70e12, 70e14):
        dynamics = arm(youngs=youngs, shoulder=RUBBED)
        flexible = dynamics.flexible_arm
        q, qd = np.array([0.4, -0.9]), np.array([2.0, -3.0])
        e = steady_bending(flexible, q, qd)
        actual = flexible.inverse(q, qd, [0, 0], e, 0 * e).efforts
        differences.append(np.abs(actual - dynamics.inverse(q, qd, [0, 0])).max())
    assert differences[1] < 1e-6 and differences[0] > 30 * differences[1], differences


SLIDER = """
robot: slider
joints:
  - {joint: turn, link: post, mass: 2, centre_of_mass: [0.1, 0, 0.2], central_inertia: {xx: 0.1, yy: 0.2, zz: 0.2}}
  - {joint: slide, type: prismatic, link: rod, mdh: {alpha: pi/2, d: 0.2}, mass: 1.5, centre_of_mass: [0, 0.1, 0.3]}
  - {joint: wrist, link: hand, mdh: {alpha: -1.1, d: 0.3, r: 0.1}, mass: 0.7, centre_of_mass: [0.2, 0, 0]}
"""


@pytest.mark.parametrize("described", ["manutec_r3", "panda", SLIDER])
def test_arm_without_beams_agrees_with_the_rigid_model(described):
    dynamics = Dynamics(load_robot(described), compiled=False)
    flexible, rng = dynamics.flexible_arm, np.random.default_rng(4)
    q, qd, qdd = rng.normal(size=(3, 5, len(dynamics.joint_names)))
    qdd[:, np.isin(dynamics.joint_names, dynamics.unactuated_joint_names)] = 0
    zero, wrenches = np.zeros((5, 0)), {dynamics.robot.links[-1].name: rng.normal(size=6)}
    expected = dynamics.solve(q, qd, qdd=qdd, external_wrenches=wrenches)
    inverse = flexible.inverse(q, qd, qdd, zero, zero, external_wrenches=wrenches)
    direct = flexible.direct(q, qd, inverse.efforts, zero, zero, external_wrenches=wrenches)
    assert np.abs(inverse.efforts - expected.efforts).max() < 1e-12 * np.abs(expected.efforts).max()
    assert np.abs(direct.accelerations - expected.accelerations).max() < 1e-11 * np.abs(expected.accelerations).max()


@pytest.mark.parametrize("q", [(0.4, 0.9), (-1.1, 2.0)])
def test_small_motion_about_rest_has_the_natural_frequencies(q):
    """Frequencies of the dynamics, linearised by differences, are those of M and K and of a finite-element model."""
    dynamics = arm(gravity=(0, 0, 0), tool=0.0)
    flexible = dynamics.flexible_arm
    q, n, m = np.array(q), 2, len(flexible.elastic_coordinate_names)
    rest, steps = np.zeros(n), 1e-5 * np.eye(m) / np.sqrt(np.diagonal(flexible.stiffness))[:, None]
    M = flexible.inertia_matrix(q, np.zeros(m))

    def frequencies(M, effective, accelerations):
        """Return frequencies [Hz] from the accelerations (m, ...) of steps in both directions."""
        K = (M @ ((accelerations[1] - accelerations[0]) / (2 * np.diagonal(steps)[:, None])).T)[-m:]
        return np.sqrt(eigvalsh((K + K.T) / 2, effective)) / (2 * np.pi)

    bent_results = [flexible.direct(q, rest, rest, sign * steps, np.zeros(m)) for sign in (1, -1)]
    effective = M[n:, n:] - M[n:, :n] @ np.linalg.solve(M[:n, :n], M[:n, n:])  # joints move as they must
    free = frequencies(
        M, effective, [np.hstack([sample.accelerations, sample.elastic_accelerations]) for sample in bent_results]
    )
    expected = Elastodynamics(dynamics, held=()).frequencies(q)
    assert not expected[:n].any()
    assert free == pytest.approx(expected[n:], rel=1e-8)

    held = [flexible.inverse(q, rest, rest, sign * steps, np.zeros(m)).elastic_accelerations for sign in (1, -1)]
    clamped = frequencies(M[n:, n:], M[n:, n:], held)
    frame, material = Frame(), [70e9, 70e9 / 2.6, 2700.0]
    upper, fore = (dynamics.link_pose(name, q) for name in ("upper", "fore"))
    base, elbow = frame.node(upper[:3, 3], clamped=True), frame.node(fore[:3, 3])
    frame.beam(base, elbow, THICK + material, upper[:3, 2], 2)
    frame.beam(elbow, frame.node(fore[:3, 3] + 0.4 * fore[:3, 0]), THIN + material, fore[:3, 2])
    assert clamped == pytest.approx(frame.frequencies(), rel=1e-8)


BLADE = """
robot: blade
gravity: [0, 0, 0]
materials: {{any: {{youngs_modulus: 1e6, poissons_ratio: 0, density: 1}}}}
sections: {{thin: {{area: 1, second_moment_y: 1e-6, second_moment_z: 1e-6, torsion_constant: 1e-3}}}}
joints:
  - joint: hub
    link: blade
    beams: [{{to: [1, 0, 0], section: thin, material: any, elements: {elements}, rotary_inertia: false}}]
  - {{type: fixed, link: tip, antecedent: blade, mdh: {{d: 1}}}}
"""  # E I = ρ A = L = 1: times are those of bending


@pytest.mark.parametrize("elements, error", [(1, 0.04), (4, 2e-3)])
def test_centrifugal_force_stiffens_a_blade(elements, error):
    """First frequency out of the plane of rotation of a uniform blade, by Wright, Smith, Thresher and Wang (1982)."""
    flexible = Dynamics(load_robot(BLADE.format(elements=elements))).flexible_arm
    m = len(flexible.elastic_coordinate_names)
    out_of_plane = [
        number for number, name in enumerate(flexible.elastic_coordinate_names) if name.endswith((".z", ".ry"))
    ]
    for speed, expected in ((0.0, 3.5160), (2.0, 4.1373), (5.0, 6.4495)):
        q, qd = np.zeros(1), np.array([speed])
        e = steady_bending(flexible, q, qd)
        steps = 1e-4 * np.eye(m)[out_of_plane]
        ahead, behind = (
            flexible.inverse(q, qd, q, e + sign * steps, np.zeros(m)).elastic_accelerations[:, out_of_plane]
            for sign in (1, -1)
        )
        squares = np.linalg.eigvals((behind - ahead) / 2e-4).real
        assert np.sqrt(squares.min()) == pytest.approx(expected, rel=error)


def test_large_deflection_of_a_cantilever_agrees_with_elliptic_integrals():
    """A cantilever with a load at its end that keeps its direction; elliptic integrals by Mattiasson (1981)."""
    flexible = Dynamics(load_robot(BLADE.format(elements=6))).flexible_arm
    q = np.zeros(1)

    def load(e):
        """Return the load in the axes of the end, which turn with it."""
        R = flexible.link_pose("tip", q, e)[..., :3, :3]
        return {"tip": np.concatenate([2.0 * R[..., 1, :], 0 * R[..., 1, :]], axis=-1)}

    e = steady_bending(flexible, q, q, load)
    tip = flexible.link_pose("tip", q, e)[:3, 3]
    assert 1 - tip[0] == pytest.approx(0.16064, abs=8e-4)
    assert tip[1] == pytest.approx(0.49346, abs=8e-4)


def test_invalid_arguments_are_refused():
    dynamics = arm()
    flexible = dynamics.flexible_arm
    m = len(flexible.elastic_coordinate_names)
    assert flexible.elastic_coordinate_names[:2] == ("upper.1.x", "upper.1.y") and m == 18
    rest, straight = np.zeros(2), np.zeros(m)
    with pytest.raises(InvalidInputError, match="one for each of 18 elastic coordinates"):
        flexible.direct(rest, rest, rest, straight[:6], straight)
    with pytest.raises(InvalidInputError, match=r"bending\[3\] is nan"):
        flexible.direct(rest, rest, rest, np.where(np.arange(m) == 3, np.nan, 0), straight)
    with pytest.raises(InvalidInputError, match=r"the end of 'upper\.2' is turned by 1\.2 rad"):
        flexible.direct(rest, rest, rest, np.where(np.arange(m) == 11, 1.2, 0), straight)
    assert flexible.direct(np.zeros((0, 2)), rest, rest, straight, straight).efforts.shape == (0, 2)
    with pytest.raises(InvalidInputError, match="do not match"):
        flexible.direct(np.zeros((3, 2)), rest, rest, np.zeros((2, m)), straight)
    with pytest.raises(InvalidInputError, match="has loops"):
        _ = Dynamics(load_robot("four_bar")).flexible_arm
    weightless = ARM.format(gravity=[0, 0, 0], youngs=7e10, shoulder="", elbow="", elements=1, tool=0.0)
    weightless = Dynamics(load_robot(weightless.replace("density: 2700", "density: 0"))).flexible_arm
    with pytest.raises(SingularModelError, match=r"'fore\.1' has no inertia"):
        weightless.direct(rest, rest, rest, np.zeros(12), np.zeros(12))
