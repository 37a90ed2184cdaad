"""Descriptions of robots on wheels, and their equations of motion from textbooks."""

import numpy as np


def body(name, mass, moments, xyz=(0, 0, 0)):
    xx, yy, zz = moments
    return f"""<link name="{name}"><inertial><origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}"/><mass value="{mass}"/>
    <inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def joint(name, parent, child, xyz, axis, kind="continuous"):
    limits = '<limit effort="100" velocity="100" lower="-100" upper="100"/>' if kind == "prismatic" else ""
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}"/><axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>{limits}</joint>"""


def robot(*parts):
    return f'<robot name="wheeled">{"".join(parts)}</robot>'


class DifferentialDrive:
    """Two actuated wheels on the axle through the origin of the base, the body's mass a distance ahead of it.

    Equations of motion in (v, ω), the centre of mass at d ahead of the axle:

        (m + 2 m_w + 2 J/r²) v̇ - m d ω² = (τ_r + τ_l)/r
        (I + m d² + 2 m_w b² + 2 I_w + 2 J b²/r²) ω̇ + m d v ω = b (τ_r - τ_l)/r
    """

    m, inertia, d, m_w, J, I_w, r, b = 12.0, 0.6, 0.15, 1.5, 0.02, 0.011, 0.1, 0.25
    urdf = robot(
        body("base_link", m, (0.5, 0.7, inertia), (d, 0, 0.05)),
        body("left_wheel", m_w, (I_w, J, I_w)),
        body("right_wheel", m_w, (I_w, J, I_w)),
        joint("left", "base_link", "left_wheel", (0, b, 0), (0, 1, 0)),
        joint("right", "base_link", "right_wheel", (0, -b, 0), (0, 1, 0)),
    )

    def accelerations(self, v, omega, left, right):
        """Return (v̇, ω̇) for torques of the wheels [N m]."""
        ahead = self.m + 2 * self.m_w + 2 * self.J / self.r**2
        about = self.inertia + self.m * self.d**2 + 2 * self.m_w * self.b**2 + 2 * self.I_w
        about += 2 * self.J * self.b**2 / self.r**2
        return (
            ((left + right) / self.r + self.m * self.d * omega**2) / ahead,
            (self.b * (right - left) / self.r - self.m * self.d * v * omega) / about,
        )


def tricycle():
    """Two rear wheels on an axle, a steered wheel ahead, and an arm of one joint on the body."""
    return robot(
        body("base_link", 20.0, (1.0, 1.0, 1.5), (0.4, 0, 0.2)),
        body("rear_left_wheel", 1.0, (0.01, 0.02, 0.01)),
        body("rear_right_wheel", 1.0, (0.01, 0.02, 0.01)),
        body("fork", 1.5, (0.02, 0.02, 0.01), (-0.02, 0, 0.1)),
        body("front_wheel", 1.0, (0.01, 0.02, 0.01)),
        body("arm", 3.0, (0.1, 0.1, 0.1), (0.3, 0, 0.1)),
        joint("rear_left", "base_link", "rear_left_wheel", (0, 0.3, 0), (0, 1, 0)),
        joint("rear_right", "base_link", "rear_right_wheel", (0, -0.3, 0), (0, 1, 0)),
        joint("steer", "base_link", "fork", (0.9, 0, 0), (0, 0, 1)),
        joint("front", "fork", "front_wheel", (-0.05, 0, 0), (0, 1, 0)),
        joint("shoulder", "base_link", "arm", (0.3, 0, 0.4), (0.2, 0.3, 0.9)),
    )


def mecanum():
    """Four mecanum wheels under a body."""
    corners = {"fl": (0.3, 0.25), "fr": (0.3, -0.25), "rl": (-0.3, 0.25), "rr": (-0.3, -0.25)}
    parts = [body("base_link", 15.0, (0.5, 0.5, 0.8))]
    for name, (x, y) in corners.items():
        parts.append(body(f"{name}_wheel", 1.0, (0.01, 0.02, 0.01)))
        parts.append(joint(name, "base_link", f"{name}_wheel", (x, y, 0), (0, 1, 0)))
    # rollers at the ground: front left and rear right heading inwards
    angles = {"fl": -np.pi / 4, "fr": np.pi / 4, "rl": np.pi / 4, "rr": -np.pi / 4}
    return robot(*parts), angles
