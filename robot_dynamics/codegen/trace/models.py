"""The models of a robot as straight-line programs, traced from the recursions of newton_euler.

Arguments and results are those of Dynamics without its checks: arrays q, qd, qdd, efforts (n,) of the independent
joints, but q (all joints,) where the robot has loops, positions that close them, as Dynamics.expand gives them; for a
moving base also `twist` (6,) and `gravity` (3,), both in the base frame, and `base_acceleration` (6,) where the base
moves as told; external wrenches, one argument a link, in the link's own frame.
"""

from dataclasses import replace

import numpy as np

from robot_dynamics.codegen.trace.parameter_grouping import group_inertial_parameters
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.constraints.attitude_charts import virtual_links
from robot_dynamics.constraints.charted_regressor import independent_regressor
from robot_dynamics.constraints.mixed_dynamics import solve_constrained_accelerations
from robot_dynamics.constraints.newton_iteration import newton_step
from robot_dynamics.constraints.state import charted_state_at, projection_matrix, state_at
from robot_dynamics.constraints.topology import build_topology
from robot_dynamics.model.mdh import MDHParameters, cosine_sine, mdh_from_placement, placement_from_mdh
from robot_dynamics.model.minimal_frames import minimal_frames
from robot_dynamics.newton_euler import composite
from robot_dynamics.newton_euler.augmented import inverse_dynamics
from robot_dynamics.newton_euler.friction import friction
from robot_dynamics.newton_euler.joint_springs import spring_force
from robot_dynamics.newton_euler.kinematics import link_placements, run_forward_pass
from robot_dynamics.newton_euler.screw import cross, wrench_to_antecedent

ZERO_SCREW = np.zeros(6, dtype=int)
# what the models of a moving base take besides
MOVING_BASE_ARGUMENTS = ("twist", "gravity")
BASE_ARGUMENTS = {
    "inverse": MOVING_BASE_ARGUMENTS,
    "direct": MOVING_BASE_ARGUMENTS,
    "state_derivative": MOVING_BASE_ARGUMENTS,
    "bias": MOVING_BASE_ARGUMENTS,
    "regressor": MOVING_BASE_ARGUMENTS,
    "gravity": ("gravity",),
    "coriolis": ("twist",),
    "frames": ("twist",),
}

# models of which the results name no rates of yaw, pitch and roll, or only in columns of parameters that are zero:
# platforms move in charts of their attitudes
CHART_MODELS = (
    *("inverse", "direct", "inertia_matrix", "gravity", "coriolis", "bias", "friction"),
    *("pose", "frames", "state_derivative", "regressor"),
)
# models that take no matrix of how all joints move with the independent ones, but where these are few
MATRIX_FREE_MODELS = ("inverse", "gravity", "coriolis", "bias")
MATRIX_FREE_THRESHOLD = 2


def inverse_model(robot, *, wrenches=(), prescribed_base=False, with_pivots=False, group_parameters=True):
    """q, qd, qdd -> efforts; of joints without motor qdd is not read, and `accelerations` (n,) of all are a second
    result; of a moving base not told how to move, `base_acceleration` (6,) is the last.

    wrenches: names of the links that external wrenches act on; told: whether the base's acceleration is an argument;
    guarded: whether `pivots` and `diagonal` (k,) are results too, where accelerations had to be solved for: they mean
    nothing where a pivot is not positive, or rounding beside its entry of the diagonal; gather: whether inertial
    parameters are gathered into the base parameters.
    """
    model = _Model("inverse", robot, ("q", "qd", "qdd"), wrenches, prescribed_base, group_parameters)
    qdd, unknown = model.inputs["qdd"], model.unactuated
    qdd = qdd * np.array([0 if number in unknown else 1 for number in range(model.size)], dtype=int)
    base_acceleration = model.base_acceleration
    if unknown or model.base_is_free:
        base_acceleration, qdd = model.accelerations(unknown, qdd, -model.passive_efforts)
    forces, _ = model.forces(qdd, base_acceleration)
    efforts = model.projected(forces + model.all_passive_efforts)
    results = {"efforts": efforts * np.array([int(k not in unknown) for k in range(model.size)], dtype=int)}
    if unknown:
        results["accelerations"] = qdd
    return model.program(results, base_acceleration, with_pivots)


def direct_model(robot, *, wrenches=(), prescribed_base=False, with_pivots=False, group_parameters=True):
    """q, qd, efforts -> accelerations, and of a moving base not told how to move `base_acceleration` (6,).

    Arguments as for `inverse_model`. Where nothing with inertia resists some motion the results are not finite.
    """
    model = _Model("direct", robot, ("q", "qd", "efforts"), wrenches, prescribed_base, group_parameters)
    nothing = np.zeros(model.size, dtype=int)
    pushes = model.inputs["efforts"] - model.passive_efforts
    base_acceleration, qdd = model.accelerations(tuple(range(model.size)), nothing, pushes)
    return model.program({"accelerations": qdd}, base_acceleration, with_pivots)


def state_derivative_model(robot, *, wrenches=(), independent=None, group_parameters=True):
    """q (all joints,), qd (n,), efforts (all joints,) -> velocities (all joints,), accelerations (n,) and, with a
    moving base, base_acceleration (6,): what a simulation integrates.

    independent: numbers of the joints that qd and the accelerations belong to. q need not close the loops to rounding:
    velocities and accelerations are smooth functions of it. Velocities of a platform's yaw, pitch and roll are those of
    the chart of its attitude, as in newton_euler.attitude.
    """
    model = _Model(
        "state_derivative",
        robot,
        ("q", "qd", "efforts"),
        wrenches,
        group_parameters=group_parameters,
        independent=independent,
    )
    model.inputs["efforts"] = efforts = model.trace.input("efforts", len(robot.joints))
    pushes = model.projected(efforts - model.all_passive_efforts)
    nothing = np.zeros(model.size, dtype=int)
    base_acceleration, qdd = model.accelerations(tuple(range(model.size)), nothing, pushes)
    return model.program({"velocities": model.qd, "accelerations": qdd}, base_acceleration)


def inertia_matrix_model(robot, *, independent=None, group_parameters=True):
    """q -> A (m, m), as Dynamics.inertia_matrix; of the joints `independent` (numbers), if given."""
    model = _Model("inertia_matrix", robot, ("q",), group_parameters=group_parameters, independent=independent)
    P = model.projection_matrix
    return model.program({"inertia_matrix": P.T @ composite.inertia_matrix(model.robot, model.q) @ P})


def gravity_model(robot, *, group_parameters=True):
    """q (and gravity (3,) in the frame of a moving base) -> gravity (m,), as Dynamics.gravity."""
    model = _Model("gravity", robot, ("q",), group_parameters=group_parameters)
    return model.program({"gravity": model.rows(-model.gravity_screw)})


def coriolis_model(robot, *, group_parameters=True):
    """q, qd (and the twist (6,) of a moving base) -> coriolis (m,), as Dynamics.coriolis."""
    model = _Model("coriolis", robot, ("q", "qd"), group_parameters=group_parameters)
    return model.program({"coriolis": model.rows(ZERO_SCREW)})


def bias_model(robot, *, group_parameters=True):
    """q, qd (twist, gravity) -> bias H (m,): gravity and Coriolis terms together, no friction."""
    model = _Model("bias", robot, ("q", "qd"), group_parameters=group_parameters)
    return model.program({"bias": model.rows(-model.gravity_screw)})


def friction_model(robot, *, group_parameters=True):
    """q, qd -> friction (n,), as Dynamics.friction: of all joints, as felt at the independent ones."""
    model = _Model("friction", robot, ("q", "qd"), group_parameters=group_parameters)
    return model.program({"friction": model.projected(friction(robot, model.qd))})


def regressor_model(robot):
    """q, qd, qdd (twist, gravity, base_acceleration) -> regressor (m, p), its columns as in newton_euler.regressor."""
    model = _Model("regressor", robot, ("q", "qd", "qdd"), prescribed_base=robot.moving_base, prepare=False)
    qdd = model.joint_accelerations(model.inputs["qdd"])
    Y = independent_regressor(model.constrained_state, model.qd, qdd, model.twist, model.base_acceleration)
    return model.program({"regressor": Y})


def closure_model(robot, *, independent=None):
    """q (m,) of the joints that follow no other one -> residual (rows,) of the loops, step (k,) that Newton's method
    takes of the joints that they place, `pivots` and `lengths` (k,) that tell of singular positions, and `placing`
    (k, k) of which the determinant is negative beyond them. independent: numbers of the joints that stay where they
    are; None: those of Dynamics."""
    trace, chosen = Trace(), _coupling(robot, independent)
    prepared_robot, shifts = prepare_robot(robot, group_parameters=False)
    chosen = chosen.with_robot(prepared_robot, shifts).with_determinant_sign()
    names = ("residual", "step", "pivots", "squared_norms", "determinant_matrix")
    results = dict(zip(names, newton_step(chosen, trace.input("q", len(chosen.non_mimic_joints))), strict=True))
    return build_program(trace, "closure", {"q": len(chosen.non_mimic_joints)}, results)


def pose_model(robot, frame):
    """q -> pose (4, 4) of a named frame in frame 0."""
    model = _Model("pose", robot, ("q",), group_parameters=False, frames=(frame,))
    placed = model.robot.frame(frame)
    R, P = link_placements(model.robot, model.q)[placed.link]
    pose = np.zeros((4, 4), dtype=object)
    pose[:3, :3], pose[:3, 3], pose[3, 3] = R, P, 1
    return model.program({"pose": pose @ placed.placement})


def frames_model(robot, frames, *, independent=None):
    """q, qd (and the twist (6,) of a moving base) -> rotations (k, 3, 3), positions (k, 3) and velocities (k, 3) of the
    origins of named frames, all in frame 0. independent: numbers of the joints that qd belongs to, if given."""
    model = _Model("frames", robot, ("q", "qd"), group_parameters=False, frames=frames, independent=independent)
    placements = link_placements(model.robot, model.q)
    twists = run_forward_pass(model.robot, model.q, model.qd, model.twist, {}).velocities
    rotations, positions, velocities = [], [], []
    for frame in map(model.robot.frame, frames):
        (R, P), offset, twist = placements[frame.link], frame.placement[:3, 3], twists[frame.link]
        rotations.append(R @ frame.placement[:3, :3])
        positions.append(P + R @ offset)
        velocities.append(R @ (twist[:3] + cross(twist[3:], offset)))
    named = {"rotations": rotations, "positions": positions, "velocities": velocities}
    return model.program({name: np.array(values, dtype=object) for name, values in named.items()})


class _Model:
    """A robot and a Trace of which the arguments are recorded: what the functions above put together."""

    def __init__(
        self,
        name,
        robot,
        arguments,
        wrenches=(),
        prescribed_base=False,
        group_parameters=True,
        prepare=True,
        frames=(),
        independent=None,
    ):
        self.name, self.trace = name, Trace()
        self.topology = _coupling(robot, independent)
        independent = self.topology.independent
        self.size = len(independent)
        self.unactuated = tuple(k for k, number in enumerate(independent) if not robot.joints[number].actuated)
        self.inputs = {key: self.trace.input(key, self.size) for key in arguments}
        named = {robot.frame(frame).link for frame in (*wrenches, *frames)}
        self._in_charts = name in CHART_MODELS and not virtual_links(robot) & named
        reoriented_joints = [one.joints[0] for one in self.topology.attitudes] if self._in_charts else ()
        self.robot, shifts = (
            prepare_robot(robot, group_parameters, reoriented_joints)
            if prepare
            else (robot, np.zeros(len(robot.joints)))
        )
        plain_q = self._positions(len(robot.joints))
        self._move(plain_q + shifts, shifts)
        self._base(BASE_ARGUMENTS.get(name, ()) if robot.moving_base else (), prescribed_base)
        self.wrenches = self._wrenches(wrenches)
        self.all_passive_efforts = np.zeros(len(robot.joints), dtype=int)
        if "qd" in self.inputs:
            self.all_passive_efforts = friction(robot, self.qd) + spring_force(robot, plain_q, self.qd)
        self.passive_efforts = self.projected(self.all_passive_efforts)
        self.pivot_results = {}

    def _positions(self, joints):
        """Positions of all joints: told by the independent ones, or all given, so that the loops are closed."""
        if self.topology.dependent:
            self.inputs["q"] = self.trace.input("q", joints)
            return self.inputs["q"]
        return self.inputs["q"] @ self.topology.S.T + self.topology.offset

    def _move(self, q, shifts):
        """Positions and velocities of all joints, and what leads to their accelerations."""
        solves = self.unactuated or self.robot.moving_base
        uses_G = (
            self.size <= MATRIX_FREE_THRESHOLD
            or self.name not in MATRIX_FREE_MODELS
            or (self.name == "inverse" and solves)
        )
        seen = self.topology.with_robot(self.robot, shifts)
        self.constrained_state = (
            charted_state_at(seen, q, bool(uses_G)) if self._in_charts else state_at(seen, q, bool(uses_G))
        )
        self.robot, self.q = self.constrained_state.robot, self.constrained_state.chart_q
        self.qd, self.constraint_drift = np.zeros(len(self.robot.joints), dtype=int), None
        if "qd" in self.inputs:
            self.qd = self.constrained_state.expand_rates(self.inputs["qd"])
            self.constraint_drift = self.constrained_state.constraint_drift(self.qd)

    def projected(self, forces):
        """What forces of all joints amount to on the independent ones (n,)."""
        return self.constrained_state.projected(forces)

    def joint_accelerations(self, qdd):
        """Accelerations of all joints."""
        return self.constrained_state.expand_rates(qdd, self.constraint_drift)

    @property
    def projection_matrix(self):
        return projection_matrix(self.constrained_state.G, 6 if self.robot.moving_base else 0)

    def _base(self, arguments, prescribed_base):
        """Twist, gravity and acceleration of the base, gravity taken off, as far as they are known."""
        for name in (*arguments, *(["base_acceleration"] if prescribed_base else [])):
            self.inputs[name] = self.trace.input(name, 3 if name == "gravity" else 6)
        moves = self.robot.moving_base
        self.base_is_free = moves and not prescribed_base
        self.twist = self.inputs.get("twist", ZERO_SCREW)
        gravity = self.inputs.get("gravity", ZERO_SCREW[:3]) if moves else self.robot.gravity
        self.gravity_screw = np.concatenate([gravity, ZERO_SCREW[3:]])
        self.base_acceleration = (
            ZERO_SCREW if self.base_is_free else self.inputs.get("base_acceleration", 0) - self.gravity_screw
        )

    def _wrenches(self, names):
        """{link number: jf_e (6,)}: what links do to their environment, in frame j, of arguments in link frames."""
        found = {}
        for name in names:
            frame = self.robot.frame(name)
            R, P = frame.placement[:3, :3], frame.placement[:3, 3]
            self.inputs[f"wrench on {name}"] = wrench = self.trace.input(f"wrench on {name}", 6)
            found[frame.link] = found.get(frame.link, 0) - wrench_to_antecedent(R, P, wrench)
        return found

    def forces(self, qdd, base_acceleration):
        """(forces (all joints,), wrench on the base (6,)) from accelerations of the independent joints."""
        return inverse_dynamics(
            self.robot, self.q, self.qd, self.joint_accelerations(qdd), self.twist, base_acceleration, self.wrenches
        )

    def rows(self, base_acceleration):
        """What the inverse model asks for with all joints unaccelerated, the rows of a moving base first."""
        forces, wrench = self.forces(np.zeros(self.size, dtype=int), base_acceleration)
        forces = self.projected(forces)
        return np.concatenate([wrench, forces]) if self.robot.moving_base else forces

    def accelerations(self, unknown, known, pushes):
        """(acceleration of the base, gravity taken off; accelerations (n,)): the unknown ones found from the pushes."""
        forces, wrench = self.forces(known, self.base_acceleration)
        bias = np.concatenate([wrench, forces]) if self.base_is_free else forces
        nothing = np.zeros(self.size, dtype=int)
        found, pivots, diagonal = solve_constrained_accelerations(
            self._matrix_robot, self.constrained_state.G, self.q, unknown, nothing, pushes, bias
        )
        self.pivot_results = {"pivots": np.array(pivots, dtype=object), "diagonal": diagonal}
        qdd = [found[len(found) - self.size + k] if k in unknown else known[k] for k in range(self.size)]
        return (found[:6] if self.base_is_free else self.base_acceleration), np.array(qdd, dtype=object)

    @property
    def _matrix_robot(self):
        """The robot of which A is taken: a base that is told how to move has no rows."""
        return self.robot if self.base_is_free else replace(self.robot, moving_base=False)

    def program(self, results, base_acceleration=None, with_pivots=False):
        if self.base_is_free and base_acceleration is not None:
            results["base_acceleration"] = base_acceleration + self.gravity_screw
        if with_pivots:
            results.update(self.pivot_results)
        return build_program(self.trace, self.name, {key: len(value) for key, value in self.inputs.items()}, results)


def _coupling(robot, independent):
    """The Coupling of a robot, with other independent joints if their numbers are given."""
    return build_topology(robot) if independent is None else build_topology(robot).with_independent(independent)


def prepare_robot(robot, group_parameters=True, reoriented_joints=()):
    """(robot, shifts): the same robot as the recursions make the smallest program of, at positions q + shifts.
    turned: as for `base_parameters.gathered`.

    Frames with the fewest numbers; constant angles about z_j added to the joint's own, but for right angles, whose
    sines and cosines are known; base inertial parameters, where `gather`.
    """
    robot = minimal_frames(replace(robot, platforms=()))  # to the recursions these are links as others
    if group_parameters:
        robot = group_inertial_parameters(robot, reoriented_joints)
    shifts, joints = np.zeros(len(robot.joints)), []
    for number, joint in enumerate(robot.joints):
        theta = mdh_from_placement(joint.placement)[-1].theta
        if not joint.prismatic and 0.0 not in cosine_sine(theta):
            shifts[number] = theta
            joint = replace(joint, placement=joint.placement @ placement_from_mdh(MDHParameters(theta=-theta)))
        joints.append(joint)
    return replace(robot, joints=tuple(joints)), shifts
