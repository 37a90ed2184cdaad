"""A Robot with loops as MJCF, and MuJoCo's answers for it: bodies with hinges and slides, loops closed by equality
constraints.

The link without inertia at which a loop is cut is left out: where the cut joint turns, two sites on its axis, one on
each side of the cut, are connected; in a spatial loop a second pair beside them holds the axis. A ball joint is one
connection too, and what is cut at no joint is a weld. A cut joint that slides has no counterpart here.

Constraints of MuJoCo are soft: what they exert is the less, the further the impedance is from 1. It is set to the most
that MuJoCo takes. Moments that are zero it refuses: each body has PADDED more of its own about every axis.

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
MUJOCO_SETTINGS = (
    f"solver Newton, tolerance 1e-10, solimp {IMPEDANCE}, solref as it comes, dense Jacobian, no warm start"
)
PADDED = 1e-12  # part of the moments of a body
MINIMAL_MASS = 1e-9  # [kg] of a link of which only the moment about its axis is told


class MujocoLoops:
    """A Robot with a fixed base, its loops closed at positions q (all joints,), in MuJoCo.

    kept: numbers of the joints that it has, those at which loops are cut left out; places: where each stands in
    MuJoCo's vectors.
    """

    def __init__(self, robot, q):
        self.robot, self.cut = robot, cut_links(robot)
        self.kept_joints = [number for number in range(len(robot.joints)) if number + 1 not in self.cut]
        self.model = mujoco.MjModel.from_xml_string(self._mjcf(q))
        self.data = mujoco.MjData(self.model)
        self.dof_indices = [self.model.joint(robot.joints[number].name).dofadr[0] for number in self.kept_joints]

    def to_mujoco_order(self, values):
        """Values (..., all joints) of the joints that MuJoCo has, in its order."""
        found = np.empty((*np.shape(values)[:-1], self.model.nv))
        found[..., self.dof_indices] = np.asarray(values)[..., self.kept_joints]
        return found

    def direct(self, q, qd, efforts):
        """Accelerations, all three in MuJoCo's order: mj_forward."""
        data = self.data
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, qd, efforts
        mujoco.mj_forward(self.model, data)
        return data.qacc

    def free(self):
        """Accelerations of the last `direct` were there no loops."""
        return self.data.qacc_smooth.copy()

    def inverse(self, q, qd, qdd):
        """Forces of all its joints, all in MuJoCo's order: mj_inverse. The part of them that passive joints are asked
        for is not passed on to those with motors."""
        data = self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        mujoco.mj_inverse(self.model, data)
        return data.qfrc_inverse

    def jacobian(self, q):
        """(rows, joints in MuJoCo's order) of its constraints."""
        self.data.qpos[:], self.data.qvel[:] = q, 0
        mujoco.mj_forward(self.model, self.data)
        return self.data.efc_J.reshape(-1, self.model.nv).copy()

    def _mjcf(self, q):
        root = ElementTree.Element("mujoco", model=self.robot.name)
        ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false")
        option = {"gravity": _text(self.robot.gravity), "solver": "Newton", "tolerance": "1e-10", "jacobian": "dense"}
        told = ElementTree.SubElement(root, "option", option)
        ElementTree.SubElement(told, "flag", contact="disable", warmstart="disable")
        self._bodies = {0: ElementTree.SubElement(root, "worldbody")}
        for number in self.kept_joints:
            self._add_body(number)
        equalities = ElementTree.SubElement(root, "equality")
        for loop in self.robot.loops:
            self._close(loop, q, equalities)
        return ElementTree.tostring(root, encoding="unicode")

    def _add_body(self, number):
        """The link that joint `number` moves, with all joints between it and the last body before it; one without
        inertia of which a single link goes on, as between the coordinates of a platform, is no body of its own."""
        if self._passes_on(number + 1):
            return
        chain = [number]
        while (carrier := self.robot.joints[chain[0]].antecedent) and self._passes_on(carrier):
            chain.insert(0, carrier - 1)
        link, placed = self.robot.links[number + 1], [self.robot.joints[chain[-1]].placement]
        for k in reversed(chain[:-1]):
            placed.insert(0, self.robot.joints[k].placement @ placed[0])
        body = ElementTree.SubElement(self._bodies[carrier], "body", name=link.name, **_pose(placed[0]))
        for k, onward in zip(chain, [*placed[1:], np.eye(4)], strict=True):
            self._add_joint(body, self.robot.joints[k], np.linalg.inv(onward))
        ElementTree.SubElement(body, "inertial", _inertial(link.inertia))
        self._bodies[number + 1] = body

    def _add_joint(self, body, joint, placed):
        """A joint about or along z of a frame that has a place in the frame of the body, where all joints are zero."""
        assert not joint.mimic and not joint.spring and not joint.coulomb_friction, f"{joint.name} is not written here"
        kind = {"type": "slide" if joint.prismatic else "hinge"}
        at = {"pos": _text(placed[:3, 3]), "axis": _text(placed[:3, 2])}
        lost = {"armature": repr(joint.rotor_inertia), "damping": repr(joint.viscous_friction)}
        ElementTree.SubElement(body, "joint", name=joint.name, **kind, **at, **lost)

    def _passes_on(self, link):
        """Whether a link has no inertia, and carries one other link and no end of a loop."""
        inertia = self.robot.links[link].inertia
        onward = [number for number in self.kept_joints if self.robot.joints[number].antecedent == link]
        ends = [end.link for loop in self.robot.loops for end in loop.ends]
        return not inertia.mass and not inertia.second_moments.any() and len(onward) == 1 and link not in ends

    def _close(self, loop, q, equalities):
        cut = next((link for link, other in self.cut.items() if other is loop), None)
        if cut is None:
            self._connect(loop.name, loop.ends, equalities, "connect" if loop.is_spherical else "weld")
            return
        joint = self.robot.joints[cut - 1]
        assert not joint.prismatic, f"{joint.name} slides"
        here, there = loop.ends if loop.moved.link == cut else loop.ends[::-1]
        onto = there.placement @ np.linalg.inv(here.placement)  # of the frame of the cut link, in the other link
        far = np.eye(4)
        far[2, 3] = self.robot.characteristic_length
        for pair, shift in enumerate([np.eye(4)] if self._is_planar(loop, q) else [np.eye(4), far]):
            ends = (joint.antecedent, joint.placement @ shift), (there.link, onto @ shift)
            self._connect(f"{loop.name}_{pair}", ends, equalities, "connect")

    def _connect(self, name, ends, equalities, kind):
        for end, (link, placement) in enumerate(ends, start=1):
            ElementTree.SubElement(self._bodies[link], "site", name=f"{name}_{end}", **_pose(placement))
        hard = {"solimp": f"{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2"}
        ElementTree.SubElement(equalities, kind, name=name, site1=f"{name}_1", site2=f"{name}_2", **hard)

    def _is_planar(self, loop, q):
        """Whether all joints of a loop turn about parallel axes."""
        ways = [set(self.robot.path_to_base(end.link)) for end in loop.ends]
        placed = link_placements(self.robot, q)
        axes = np.array([placed[number + 1][0][:, 2] for number in ways[0] ^ ways[1]])
        turns = not any(self.robot.joints[number].prismatic for number in ways[0] ^ ways[1])
        return turns and np.abs(np.cross(axes, axes[0])).max() < 1e-9


def _text(values):
    return " ".join(repr(float(value)) for value in values)


def _pose(placement):
    turned = Rotation.from_matrix(placement[:3, :3]).as_quat()
    return {"pos": _text(placement[:3, 3]), "quat": _text(np.roll(turned, 1))}


def _inertial(inertia):
    if inertia.is_moment_about_z:
        about_z = inertia.second_moments[2, 2]  # nothing else counts; two halves beside it are a body that can be
        mass, centre, central = MINIMAL_MASS, np.zeros(3), np.diag([0.5, 0.5, 1]) * about_z
    else:
        mass = inertia.mass
        centre = inertia.first_moments / mass
        central = inertia.second_moments + mass * skew(centre) @ skew(centre)
    central = central + PADDED * np.trace(central) * np.eye(3)
    entries = central[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return {"mass": repr(float(mass)), "pos": _text(centre), "fullinertia": _text(entries)}
