"""How a serial or branched robot moves whose links bend, rigid and elastic motion together: `Dynamics.flexible_arm`."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.flexible.block_recursion import solve, sweep_forward
from robot_dynamics.flexible.structure import build_structure, nearest_node
from robot_dynamics.inputs import base_state, common_batch_shape, require_finite
from robot_dynamics.newton_euler.friction import friction
from robot_dynamics.newton_euler.joint_springs import spring_force
from robot_dynamics.newton_euler.screw import wrench_to_antecedent
from robot_dynamics.results import broadcast_result

MAX_ROTATION = 1.0  # [rad] of the end of an element; what bends more is not slightly bent


@dataclass(frozen=True, eq=False)
class FlexibleDynamicsResult:
    """accelerations: (..., n) of the joints [rad/s² or m/s²]; elastic_accelerations: (..., m) [m/s² or rad/s²];
    efforts: (..., n) of their motors [N m or N]."""

    accelerations: np.ndarray
    elastic_accelerations: np.ndarray
    efforts: np.ndarray


class FlexibleArm:
    """Inverse and direct dynamics of a robot whose links bend; `Dynamics.flexible_arm` gives it.

    joint_names: of the n joints, as Dynamics has them. elastic_names: of the m elastic coordinates,
    `link.element.component` (x, y, z [m], rx, ry, rz [rad]): by how much the end of an element has moved and turned
    against its beginning, in the axes of that, x along the element.

    q, qd, qdd, efforts are (..., n), e and ed (..., m); external_wrenches: {link or frame: (..., 6)}, what the
    environment does to it, in its own axes at its origin. Frames move as the links bend. Joints without motor move as
    they must, whether they have a brake or not.

    Approximate is only the shape of an element against its own beginning: that of a slender beam, slightly bent, whose
    end comes nearer as it bends, so that centrifugal forces stiffen it and weights soften it. For that shape all is
    exact: how far the frames behind it are carried, and the inertia forces of the bent beam in any motion. Cut into
    more elements, a beam may bend far. Left out: shear, damping of the material, and what torsion and bending do to
    each other within an element.

    Raises QuestionError for robots with loops, platforms, joints that follow others, or a base that moves, and for
    elements whose ends turn by more than 1 rad; SingularModelError where something moves without inertia.
    """

    def __init__(self, dynamics):
        self._dynamics, self._robot = dynamics, dynamics.robot
        _refuse_others(self._robot)
        self.structure = build_structure(self._robot, held=())
        own = [list(node.coordinates) for node in self.structure.nodes]
        where = {node.joint_number: node.coordinates[0] for node in self.structure.nodes if node.joint is not None}
        self._joints = [where[number] for number in range(len(self._robot.joints))]
        self._elements = [pair for pair in zip(self.structure.nodes, own, strict=True) if pair[0].element is not None]
        self._elastic = [number for _, numbers in self._elements for number in numbers]
        self.joint_names = dynamics.joint_names
        self.elastic_coordinate_names = tuple(self.structure.coordinates[number] for number in self._elastic)

    @property
    def stiffness(self):
        """K (m, m) [N/m, N, N m]: K e is what bends the links."""
        K = np.zeros((len(self.structure.coordinates),) * 2)
        for node, own in self._elements:
            K[np.ix_(own, own)] = node.element.stiffness
        return K[np.ix_(self._elastic, self._elastic)]

    def inverse(self, q, qd, qdd, e, ed, *, external_wrenches=None):
        """The FlexibleMotion of joints that move as told, their links being bent as told: efforts, and how the bending
        goes on. Source: Khalil, sections 3.2 and 6, with elastic coordinates for elastic joints."""
        driven = np.array([joint.actuated for joint in self._robot.joints], dtype=bool)
        return self._moved(q, qd, e, ed, external_wrenches, driven, qdd=self._driven("accelerations", qdd))

    def direct(self, q, qd, efforts, e, ed, *, external_wrenches=None):
        """The FlexibleMotion that efforts, gravity and the bent links cause. Source: Khalil, section 3.3.2."""
        driven = np.zeros(len(self._robot.joints), dtype=bool)
        return self._moved(q, qd, e, ed, external_wrenches, driven, efforts=self._driven("efforts", efforts))

    def inertia_matrix(self, q, e):
        """M(q, e) (..., n + m, n + m), of the joints, then of the elastic coordinates; rotors are counted."""
        q, e = self._shape(q, e)
        places = [*self._joints, *self._elastic]
        x, _ = self._coordinates(common_batch_shape(q, e), q, 0.0, e, 0.0)
        x = np.repeat(x[..., None, :], len(places), axis=-2)  # for each a unit acceleration, nothing else
        units = np.broadcast_to(np.eye(len(places))[places], x.shape)
        sweep = sweep_forward(self.structure, x, np.zeros_like(x), {})
        none = np.zeros(len(places), dtype=bool)
        M = solve(self.structure, sweep, units, np.zeros_like(x), none, np.zeros(6))[1][..., places]
        return (M + np.swapaxes(M, -1, -2)) / 2

    def link_pose(self, name, q, e):
        """Pose (..., 4, 4) of a link or of another frame, in frame 0, where its links are bent by e."""
        q, e = self._shape(q, e)
        node, placed = self._fastened(name)
        x, _ = self._coordinates(common_batch_shape(q, e), q, 0.0, e, 0.0)
        sweep = sweep_forward(self.structure, x, np.zeros_like(x), {})
        pose = placed
        while node:
            attached, here = sweep.attached[node], np.zeros((*x.shape[:-1], 4, 4))
            here[..., :3, :3], here[..., :3, 3] = attached.rotations[..., -1, :, :], attached.positions[..., -1, :]
            here[..., 3, 3] = 1
            pose, node = here @ pose, self.structure.nodes[node].parent
        return broadcast_result(pose, x.shape[:-1], axes=2)

    def _moved(self, q, qd, e, ed, external_wrenches, driven, qdd=None, efforts=None):
        """The FlexibleMotion where accelerations of the joints `driven` are given, and efforts of the others."""
        q, e = self._shape(q, e)
        qd, ed = self._vector("velocities", qd), self._bending("rates of bending", ed)
        wrenches = self._wrenches(external_wrenches)
        given = qdd if efforts is None else efforts
        batch = common_batch_shape(q, qd, e, ed, given, *wrenches.values())
        x, rates = self._coordinates(batch, q, qd, e, ed)
        accelerations, forces = np.zeros_like(x), np.zeros_like(x)
        with np.errstate(all="ignore"):  # what is not finite is refused in the end
            lost = friction(self._robot, qd) + spring_force(self._robot, q, qd)
            forces[..., self._elastic] = -e @ self.stiffness
            forces[..., self._joints] = -lost if efforts is None else efforts - lost
            if qdd is not None:
                accelerations[..., self._joints] = qdd
            found = np.ones(x.shape[-1], dtype=bool)
            found[self._joints] = ~driven
            sweep = sweep_forward(self.structure, x, rates, wrenches)
            ground = base_state(self._robot, None).rest_acceleration
            accelerations, forces = solve(self.structure, sweep, accelerations, forces, found, ground)
            if efforts is None:
                efforts = np.where(driven, forces[..., self._joints] + lost, 0.0)  # of the others it is rounding
        return FlexibleDynamicsResult(
            broadcast_result(accelerations[..., self._joints], batch),
            broadcast_result(accelerations[..., self._elastic], batch),
            broadcast_result(efforts, batch),
        )

    def _coordinates(self, batch, q, qd, e, ed):
        """(positions, rates) (..., g) in the order of the structure."""
        x, rates = (np.zeros((*batch, len(self.structure.coordinates))) for _ in range(2))
        x[..., self._joints], x[..., self._elastic] = q, e
        rates[..., self._joints], rates[..., self._elastic] = qd, ed
        return x, rates

    def _vector(self, what, values, ignored_columns=None):
        return require_finite(
            what, values, len(self.joint_names), f"joints ({', '.join(self.joint_names)})", ignored_columns
        )

    def _driven(self, what, values):
        why = "no motor drives it, so the acceleration is part of the answer and the effort is zero"
        unactuated = [number for number, joint in enumerate(self._robot.joints) if not joint.actuated]
        return self._vector(what, values, dict.fromkeys(unactuated, why))

    def _bending(self, what, values):
        return require_finite(
            what, values, len(self.elastic_coordinate_names), "elastic coordinates, those of elastic_names"
        )

    def _shape(self, q, e):
        """q and e checked, elements being but slightly bent."""
        q, e = self._vector("positions", q), self._bending("bending", e)
        turned = e.reshape(*e.shape[:-1], len(self._elements), 6)[..., 3:]
        angles = np.linalg.norm(turned, axis=-1)
        if angles.size and angles.max() > MAX_ROTATION:
            name = self.elastic_coordinate_names[6 * (int(np.argmax(angles)) % angles.shape[-1])].rsplit(".", 1)[0]
            raise InvalidInputError(
                f"the end of {name!r} is turned by {angles.max():.3g} rad against its beginning: elements bend but "
                f"slightly, {MAX_ROTATION:g} rad at most. Cut its beam into more elements"
            )
        return q, e

    def _fastened(self, name):
        """(node, placement (4, 4) in it) of a frame."""
        frame = self._robot.frame(name)
        nodes = [number for number, node in enumerate(self.structure.nodes) if node.link == frame.link]
        return nearest_node(self.structure.nodes, nodes, frame.placement)

    def _wrenches(self, told):
        """{node: (..., 6) what its environment does to it, at its origin and in its axes}."""
        if told is not None and not hasattr(told, "items"):
            raise InvalidInputError(f"external_wrenches: {{link name: (..., 6)}} is needed, not {type(told).__name__}")
        found = {}
        for name, wrench in (told or {}).items():
            node, placed = self._fastened(name)
            wrench = require_finite(f"wrench on {name!r}", wrench, 6, "components of force and torque")
            found[node] = found.get(node, 0) + wrench_to_antecedent(placed[:3, :3], placed[:3, 3], wrench)
        return found


def _refuse_others(robot):
    """Refuse what is not a tree of joints that move on their own, on a fixed base."""
    reasons = {
        "loops": bool(robot.loops),
        "a platform": bool(robot.platforms),
        "a base that moves": robot.moving_base,
        "joints that follow others": any(joint.mimic is not None for joint in robot.joints),
    }
    for reason, given in reasons.items():
        if given:
            raise InvalidInputError(
                f"{robot.name!r} has {reason}: with links that bend, only dynamics of chains and trees on a fixed base "
                "are there. Natural frequencies are: `Dynamics.elastodynamics`"
            )
