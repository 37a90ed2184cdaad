"""A Robot with loops in MuJoCo: bodies with hinges and slides, and loops closed by equality constraints.

Links without inertia at which loops are cut are omitted. For a revolute cut joint, two sites on its axis, one on each
side of the cut, are connected; in a spatial loop a second pair beside them holds the axis. A ball joint is one
connection, and a loop that is cut at no joint is closed by a weld. Prismatic cut joints are not supported.

Constraints of MuJoCo are soft: their forces decrease as the impedance departs from 1. It is set to the maximum that
MuJoCo accepts. MuJoCo refuses moments of inertia of zero: each body gets PADDED of its own moments about every axis.

Source: https://mujoco.readthedocs.io, chapters Computation (constraint model) and XML reference.
"""

from xml.etree import ElementTree

import mujoco
import numpy as np
from peers.maximal_coordinates import cut_links
from scipy.spatial.transform import Rotation

from robot_dynamics.model.inertia import skew
from robot_dynamics.newton_euler.kinematics import link_placements

IMPEDANCE = mujoco.mjMAXIMP
MUJOCO_SETTINGS = f"solver Newton, tolerance 1e-10, solimp {IMPEDANCE}, default solref, dense Jacobian, no warm start"
PADDED = 1e-12
"""Moment of inertia added about every axis, relative to the moments of the body."""

MINIMAL_MASS = 1e-9
"""Mass of links that have only a moment about their axis [kg]."""


class MujocoLoops:
    """A Robot with a fixed base in MuJoCo, its loops closed at positions q (all joints,).

    Attributes
    ----------
    kept_joints : list of int
        Numbers of the joints in MuJoCo: all but those at which loops are cut.
    dof_indices : list of int
        Index of each of them in MuJoCo's vectors.
    """

    def __init__(self, robot, q):
        self.robot = robot
        self.cut = cut_links(robot)
        self.kept_joints = [number for number in range(len(robot.joints)) if number + 1 not in self.cut]
        self.model = mujoco.MjModel.from_xml_string(self._mjcf(q))
        self.data = mujoco.MjData(self.model)
        self.dof_indices = [self.model.joint(robot.joints[number].name).dofadr[0] for number in self.kept_joints]

    def to_mujoco_order(self, values):
        """Values (..., all joints) of the joints that MuJoCo has, in its order."""
        ordered = np.empty((*np.shape(values)[:-1], self.model.nv))
        ordered[..., self.dof_indices] = np.asarray(values)[..., self.kept_joints]
        return ordered

    def direct(self, q, qd, efforts):
        """Accelerations by mj_forward; arguments and result are in MuJoCo's order."""
        data = self.data
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, qd, efforts
        mujoco.mj_forward(self.model, data)
        return data.qacc

    def free(self):
        """Accelerations at the last call of `direct` without the loops."""
        return self.data.qacc_smooth.copy()

    def inverse(self, q, qd, qdd):
        """Forces of all joints by mj_inverse, in MuJoCo's order; those of passive joints are not projected onto the
        motors."""
        data = self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        mujoco.mj_inverse(self.model, data)
        return data.qfrc_inverse

    def jacobian(self, q):
        """Jacobian of the constraints (rows, joints in MuJoCo's order)."""
        self.data.qpos[:], self.data.qvel[:] = q, 0
        mujoco.mj_forward(self.model, self.data)
        return self.data.efc_J.reshape(-1, self.model.nv).copy()

    def _mjcf(self, q):
        root = ElementTree.Element("mujoco", model=self.robot.name)
        ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false")
        option = {"gravity": _text(self.robot.gravity), "solver": "Newton", "tolerance": "1e-10", "jacobian": "dense"}
        option_element = ElementTree.SubElement(root, "option", option)
        ElementTree.SubElement(option_element, "flag", contact="disable", warmstart="disable")
        self._bodies = {0: ElementTree.SubElement(root, "worldbody")}
        for number in self.kept_joints:
            self._add_body(number)
        equalities = ElementTree.SubElement(root, "equality")
        for loop in self.robot.loops:
            self._close(loop, q, equalities)
        return ElementTree.tostring(root, encoding="unicode")

    def _add_body(self, number):
        """Add the link that joint `number` moves, with all joints between it and the body before it.

        Links without inertia and with one successor, as between the coordinates of a platform, become no bodies.
        """
        if self._is_intermediate(number + 1):
            return
        chain = [number]
        while (carrier := self.robot.joints[chain[0]].antecedent) and self._is_intermediate(carrier):
            chain.insert(0, carrier - 1)
        link = self.robot.links[number + 1]
        placements = [self.robot.joints[chain[-1]].placement]
        for k in reversed(chain[:-1]):
            placements.insert(0, self.robot.joints[k].placement @ placements[0])
        body = ElementTree.SubElement(self._bodies[carrier], "body", name=link.name, **_pose(placements[0]))
        for k, remaining in zip(chain, [*placements[1:], np.eye(4)], strict=True):
            self._add_joint(body, self.robot.joints[k], np.linalg.inv(remaining))
        ElementTree.SubElement(body, "inertial", _inertial(link.inertia))
        self._bodies[number + 1] = body

    def _add_joint(self, body, joint, placement):
        """Add a joint about or along z of a frame with a placement in the body at zero joint positions."""
        assert not joint.mimic and not joint.spring and not joint.coulomb_friction, f"{joint.name} is not supported"
        kind = {"type": "slide" if joint.prismatic else "hinge"}
        axis = {"pos": _text(placement[:3, 3]), "axis": _text(placement[:3, 2])}
        passive = {"armature": repr(joint.rotor_inertia), "damping": repr(joint.viscous_friction)}
        ElementTree.SubElement(body, "joint", name=joint.name, **kind, **axis, **passive)

    def _is_intermediate(self, link):
        """Whether a link has no inertia, one successor and no end of a loop."""
        inertia = self.robot.links[link].inertia
        successors = [number for number in self.kept_joints if self.robot.joints[number].antecedent == link]
        ends = [end.link for loop in self.robot.loops for end in loop.ends]
        return not inertia.mass and not inertia.second_moments.any() and len(successors) == 1 and link not in ends

    def _close(self, loop, q, equalities):
        cut = next((link for link, cut_loop in self.cut.items() if cut_loop is loop), None)
        if cut is None:
            self._connect(loop.name, loop.ends, equalities, "connect" if loop.is_spherical else "weld")
            return
        joint = self.robot.joints[cut - 1]
        assert not joint.prismatic, f"{joint.name} is prismatic"
        cut_end, closing_end = loop.ends if loop.moved.link == cut else loop.ends[::-1]
        # of the frame of the cut link in the frame of the link on which the loop closes
        cut_placement = closing_end.placement @ np.linalg.inv(cut_end.placement)
        along_axis = np.eye(4)
        along_axis[2, 3] = self.robot.characteristic_length
        for pair, shift in enumerate([np.eye(4)] if self._is_planar(loop, q) else [np.eye(4), along_axis]):
            ends = (joint.antecedent, joint.placement @ shift), (closing_end.link, cut_placement @ shift)
            self._connect(f"{loop.name}_{pair}", ends, equalities, "connect")

    def _connect(self, name, ends, equalities, kind):
        for end, (link, placement) in enumerate(ends, start=1):
            ElementTree.SubElement(self._bodies[link], "site", name=f"{name}_{end}", **_pose(placement))
        impedance = {"solimp": f"{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2"}
        ElementTree.SubElement(equalities, kind, name=name, site1=f"{name}_1", site2=f"{name}_2", **impedance)

    def _is_planar(self, loop, q):
        """Whether all joints of a loop are revolute with parallel axes."""
        paths = [set(self.robot.path_to_base(end.link)) for end in loop.ends]
        joints = paths[0] ^ paths[1]
        placements = link_placements(self.robot, q)
        axes = np.array([placements[number + 1][0][:, 2] for number in joints])
        is_revolute = not any(self.robot.joints[number].prismatic for number in joints)
        return is_revolute and np.abs(np.cross(axes, axes[0])).max() < 1e-9


def _text(values):
    return " ".join(repr(float(value)) for value in values)


def _pose(placement):
    quaternion = Rotation.from_matrix(placement[:3, :3]).as_quat()
    return {"pos": _text(placement[:3, 3]), "quat": _text(np.roll(quaternion, 1))}


def _inertial(inertia):
    if inertia.is_moment_about_z:
        about_z = inertia.second_moments[2, 2]  # the others have no effect; halves of it make a possible body
        mass, centre, central = MINIMAL_MASS, np.zeros(3), np.diag([0.5, 0.5, 1]) * about_z
    else:
        mass = inertia.mass
        centre = inertia.first_moments / mass
        central = inertia.second_moments + mass * skew(centre) @ skew(centre)
    central = central + PADDED * np.trace(central) * np.eye(3)
    entries = central[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return {"mass": repr(float(mass)), "pos": _text(centre), "fullinertia": _text(entries)}
