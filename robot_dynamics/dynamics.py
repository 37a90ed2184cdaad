"""The one door to the dynamics of a robot: `Dynamics(robot)`. What numbers mean is the same here and on every topic.

Joint vectors are (..., n) in the order of `joint_names`, one sample (n,) or any batch (N, n). SI units. Efforts are
what the actuators deliver at the joints. External wrenches are what the environment does to a link, [force; torque] in
the link's own frame at its origin. Accelerations are true (gravity is not taken off) and classical, of the frame's
origin.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from robot_dynamics.codegen.jit.compiled_models import MODELS, CompiledModels, available_models
from robot_dynamics.codegen.program_calls import evaluate_model
from robot_dynamics.constraints.attitude_charts import virtual_links
from robot_dynamics.constraints.charted_regressor import independent_regressor
from robot_dynamics.constraints.closure_solver import ClosureSolver
from robot_dynamics.constraints.mixed_dynamics import RobotState, compute_link_wrenches, solve_mixed_dynamics
from robot_dynamics.constraints.state import projection_matrix
from robot_dynamics.errors import InvalidInputError, SingularModelError, describe_unknown_name
from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics.flexible.flexible_arm import FlexibleArm
from robot_dynamics.inputs import Base, base_state, common_batch_shape, link_wrenches, require_finite
from robot_dynamics.model.placement import invert_placement
from robot_dynamics.model.robot import Robot
from robot_dynamics.newton_euler.equilibrium import find_equilibrium
from robot_dynamics.newton_euler.friction import friction
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.joint_springs import spring_force
from robot_dynamics.newton_euler.kinematics import link_placements, run_forward_pass
from robot_dynamics.newton_euler.regressor import parameter_names, parameters
from robot_dynamics.newton_euler.screw import apply_transposed, wrench_to_antecedent
from robot_dynamics.newton_euler.walker_orin import bias, inertia_matrix
from robot_dynamics.parallel.platform_dynamics import PlatformDynamics, Platforms
from robot_dynamics.results import (
    BASE_ROWS,
    DynamicsResult,
    Equilibrium,
    JointMotion,
    broadcast_result,
    refuse_unbalanced,
)

__all__ = ["BASE_ROWS", "Base", "Dynamics", "DynamicsResult", "Equilibrium"]


class Dynamics:
    """Inverse and direct dynamics of a robot, for one sample or a batch.

    joint_names: the joints of the vectors, in their order: branch by branch, as the description has them. Joints that
    depend on others (mimic joints, passive joints of loops) are not among them; all_joint_names has these too.
    `expand`, `expand_rates`, `expand_accelerations`, `gather_efforts` and `spread_efforts` go from one set to the
    other. undriven_joint_names: those of joint_names that are elastic or passive. Their positions and velocities are
    part of the state as those of any joint; their accelerations are always part of the answer and their efforts always
    zero, so that in a question 0 or nan stands there.

    Arguments are q, qd, qdd, efforts: (..., n); base: a Base, for a robot with a moving base and for no other;
    external_wrenches: {link name: (..., 6)}. Every method raises QuestionError for an argument that does not fit.

    Where the robot has loops, q may have all joints too (..., all joints): the positions of the joints that the loops
    place, `looped_joint_names`, are then where the search for them begins, and choose the assembly mode; nan says
    nothing, and some of them may be enough. A sample without any is closed in the mode of the initial positions of the
    description. Every method raises
    SingularModelError where the loops do not close, or do not tell where the other joints are. Nothing is remembered
    between two calls.

    compiled: whether inverse, direct, inertia_matrix, gravity and coriolis go on as compiled programs when the
    recursions have been asked for some time; nothing ever waits for a compiler but `compile`. Answers then differ in
    the last digits.
    """

    def __init__(self, robot, *, compiled=True):
        if not isinstance(robot, Robot):
            raise InvalidInputError(f"Dynamics takes a Robot, as load_robot gives it, not {robot!r:.60}")
        self.robot = robot
        self._programs = CompiledModels(robot)
        self._closure_solver = ClosureSolver(robot, self._programs if compiled else None)
        self._base_rows = 6 if robot.moving_base else 0
        # how each frame j stands in the link frame that the description gives
        placements = [invert_placement(robot.frame(link.name).placement) for link in robot.links]
        self._in_link_frame = [(placed[:3, :3], placed[:3, 3]) for placed in placements]
        self.all_joint_names = tuple(joint.name for joint in robot.joints)
        self.joint_names = tuple(self.all_joint_names[number] for number in self._closure_solver.independent)
        self.dependent_joint_names = tuple(self.all_joint_names[number] for number in self._closure_solver.dependent)
        driven = [robot.joints[number].actuated for number in self._closure_solver.independent]
        self._undriven = [place for place, has_motor in enumerate(driven) if not has_motor]
        self.unactuated_joint_names = tuple(self.joint_names[place] for place in self._undriven)
        self.compiled = compiled

    def __repr__(self):
        return f"Dynamics({self.robot!r})"

    def __reduce__(self):
        """Copied and sent to other processes without its programs: machine code belongs to this one."""
        return partial(Dynamics, compiled=self.compiled), (self.robot,)

    def inverse(self, q, qd, qdd, *, base=None, external_wrenches=None):
        """Efforts (..., n) [N m or N] of a motion: bodies, rotors, gravity, friction and springs, less the external
        wrenches. Joints without motor move as they must, and have effort zero; `solve` tells their accelerations.

        Source: Khalil, sections 3.2, 6 and 7.2.
        """
        q = self._positions(q)
        given = {"q": q, "qd": self._joints("velocities", qd), "qdd": self._driven("accelerations", qdd)}
        question = {"base": base, "external_wrenches": external_wrenches}
        return self._computed("inverse", given, question, lambda: self.solve(q, qd, qdd=qdd, **question).efforts)

    def direct(self, q, qd, efforts, *, base=None, external_wrenches=None):
        """Accelerations (..., n) [rad/s² or m/s²] that efforts, springs and gravity cause.

        Raises SingularModelError where some motion moves nothing with inertia. Source: Khalil, sections 3.3.2, 6, 7.3.
        """
        q = self._positions(q)
        given = {"q": q, "qd": self._joints("velocities", qd), "efforts": self._driven("efforts", efforts)}
        question = {"base": base, "external_wrenches": external_wrenches}
        return self._computed(
            "direct", given, question, lambda: self.solve(q, qd, efforts=efforts, **question).accelerations
        )

    def solve(self, q, qd, *, qdd=None, efforts=None, base=None, external_wrenches=None):
        """The whole Answer for accelerations qdd or for efforts, whichever is given; see `inverse` and `direct`."""
        if (qdd is None) == (efforts is None):
            raise InvalidInputError("give accelerations or efforts, one of the two: the other is the answer")
        given = self._driven("efforts", efforts) if qdd is None else self._driven("accelerations", qdd)
        state = self._state(q, qd, base, external_wrenches, given)
        with np.errstate(all="ignore"):  # what is not finite is refused below
            lost = friction(self.robot, state.qd) + spring_force(self.robot, state.q, state.qd)
            gathered = state.constrained_state.projected
            if qdd is None:
                every, nothing = range(len(self.joint_names)), np.zeros(len(self.joint_names))
                qdd, forces, *caused = solve_mixed_dynamics(state, every, nothing, given - gathered(lost))
                efforts = given
            else:
                qdd, forces, *caused = solve_mixed_dynamics(state, self._undriven, given, -gathered(lost))
                efforts = gathered(forces + lost)
                efforts[..., self._undriven] = 0  # what is left is rounding
            base_acceleration, wrenches = caused
            everyone = state.expand_accelerations(qdd)
            if self.robot.loops:
                wrenches = compute_link_wrenches(state, everyone, base_acceleration, forces + lost)
            reactions = self._in_link_frames(wrenches)
            base_acceleration = state.base.true_acceleration(base_acceleration)
        return DynamicsResult(
            broadcast_result(qdd, state.batch),
            broadcast_result(efforts, state.batch),
            JointMotion(*state.joint_motion(everyone)),
            broadcast_result(base_acceleration, state.batch) if self.robot.moving_base else None,
            broadcast_result(reactions, state.batch, axes=2),
        )

    def compile(self, model, *, wrenches=(), prescribed_base=False, independent=None):
        """The compiled program of a model, made now if it is not there: the fastest that can be called from Python.

        model: inverse, direct, inertia_matrix, gravity, coriolis, bias, friction, regressor, or of a robot with loops
        closure and state_derivative; what each takes and gives,
        `robot_dynamics.codegen.trace.models` tells. wrenches: names of the links that external wrenches act on, and told:
        whether the acceleration of a moving base is given, for inverse and direct. independent: numbers of the joints
        that move independently, where they are to be others than joint_names, for inertia_matrix, closure
        and state_derivative.

        The program has `evaluate(q, qd, qdd)` for one sample, which takes buffers of float64 and gives a new array, or
        with one argument more writes into it, and `batch(q, qd, qdd, out=None, threads=1)` for arrays (N, n). It
        refuses buffers that do not fit, but checks no values: nan in gives nan out.

        Raises QuestionError for an unknown model or link and for a robot of which nothing moves, SingularModelError
        where the model has no answer in any state.
        """
        if not (self.joint_names or self.robot.moving_base):
            raise InvalidInputError(f"{self.robot.name!r} has no joints: there is nothing to compile")
        if model not in MODELS:
            raise InvalidInputError(describe_unknown_name("model", model, MODELS))
        if model not in available_models(self.robot):
            raise InvalidInputError(f"{self.robot.name!r} has no loops that could be closed")
        for name in wrenches:
            self.robot.frame(name)
        independent = None if independent is None else tuple(independent)
        return self._programs.get(model, tuple(wrenches), bool(prescribed_base), independent=independent)

    def inertia_matrix(self, q):
        """A (..., n, n) [kg m², kg m or kg], rotors counted; with a moving base (..., 6 + n, 6 + n), the base first.

        Source: Khalil, sections 3.3.1 and 7.1.
        """
        q = self._positions(q)
        return self._computed("inertia_matrix", {"q": q}, None, lambda: self._inertia_matrix(q))

    def _inertia_matrix(self, q):
        configuration = self._closure_solver.state_at(q)
        P = projection_matrix(configuration.G, self._base_rows)
        with np.errstate(all="ignore"):
            A = inertia_matrix(configuration.robot, configuration.chart_q)
            return broadcast_result(np.swapaxes(P, -1, -2) @ A @ P, q.shape[:-1], axes=2)

    def gravity(self, q, *, base=None):
        """g(q) alone (..., n): the efforts that hold the robot at rest; with a moving base (..., 6 + n)."""
        q = self._positions(q)

        def recursion():
            state = self._state(q, np.zeros(len(self.joint_names)), base)
            return self._bias(state, base, np.zeros(6), state.base.rest_acceleration)

        return self._computed("gravity", {"q": q}, {"base": base}, recursion)

    def coriolis(self, q, qd, *, base=None):
        """C(q, q̇)q̇ alone (..., n): neither gravity nor friction; with a moving base (..., 6 + n), the base first."""
        q = self._positions(q)

        def recursion():
            state = self._state(q, qd, base)
            return self._bias(state, base, state.base.twist, np.zeros(6))

        given = {"q": q, "qd": self._joints("velocities", qd)}
        return self._computed("coriolis", given, {"base": base}, recursion)

    def regressor(self, q, qd, qdd, *, base=None):
        """Y (..., n, p): efforts of a motion are Y @ parameters, springs apart, for the inertial parameters, rotors and
        friction of `parameter_names`. With a moving base, the acceleration of which Base must tell, (..., 6 + n, p).

        Links between yaw, pitch and roll of a platform have no body: their columns, and those of these three joints,
        say what one would add. They grow with 1/cos² of pitch, and are zero where |cos pitch| is less than 1e-12.

        Source: Khalil, section 4, for loops: Gᵀ times that of the tree.
        """
        q, qdd = self._positions(q), self._joints("accelerations", qdd)
        if self.robot.moving_base and (base is None or base.acceleration is None):
            raise InvalidInputError("the regressor takes a base that moves as told: give its acceleration in Base")

        def recursion():
            state = self._state(q, qd, base, given=qdd)
            moving, at = (state.base.twist, state.base.acceleration), state.constrained_state
            with np.errstate(all="ignore"):
                return broadcast_result(
                    independent_regressor(at, state.qd, state.expand_accelerations(qdd), *moving), state.batch, axes=2
                )

        given = {"q": q, "qd": self._joints("velocities", qd), "qdd": qdd}
        return self._computed("regressor", given, {"base": base}, recursion)

    @property
    def parameter_names(self):
        """What the columns of `regressor` stand for: XX.link, ... M.link, Ia.joint, Fv.joint, Fs.joint."""
        return parameter_names(self.robot)

    @property
    def parameters(self):
        """(p,) the values that the robot has for `parameter_names`."""
        return parameters(self.robot)

    def _computed(self, model, given, question, recursion):
        """`answered`, where there is a program that could answer."""
        question = question or {}
        if not (self.compiled and self.joint_names and isinstance(question.get("external_wrenches"), Mapping | None)):
            return recursion()
        return evaluate_model(self._programs, self.robot, model, given, question, recursion)

    def friction(self, qd, q=None):
        """Viscous and Coulomb friction alone (..., n) [N m or N], of passive joints too; none at rest.

        q: where the robot has loops it has a part in it, else it may be left out.
        """
        qd, configuration = self._joints("velocities", qd), self._somewhere(q)
        with np.errstate(all="ignore"):
            found = configuration.projected(friction(self.robot, configuration.expand_rates(qd)))
        return broadcast_result(found, common_batch_shape(qd, None if q is None else configuration.q))

    def elasticity(self, q, qd):
        """What springs and dampers at the joints demand, alone (..., n): k (q - q₀) + damping · q̇ [N m or N]."""
        qd, configuration = self._joints("velocities", qd), self._closure_solver.state_at(q)
        with np.errstate(all="ignore"):
            found = configuration.projected(spring_force(self.robot, configuration.q, configuration.expand_rates(qd)))
        return broadcast_result(found, common_batch_shape(configuration.q, qd))

    def equilibrium(self, q, *, base=None, external_wrenches=None):
        """The Equilibrium in which the joints without motor come to rest, the others held where q (..., n) has them.

        For the joints without motor q says where they are let go: they move downhill, as if through thick oil. A moving
        base is held at its pose at rest, or moved on with the acceleration that Base gives.

        Raises SingularModelError where none is found. Source: Khalil, section 6, at rest.
        """
        state = self._state(q, np.zeros(len(self.joint_names)), base, external_wrenches)
        if np.any(state.base.twist):
            raise InvalidInputError("an equilibrium is at rest: leave the twist out of Base")
        acceleration = state.base.rest_acceleration if state.base.acceleration is None else state.base.acceleration
        stable = np.True_
        with np.errstate(all="ignore"):
            if len(self._undriven):
                q = state.q[..., self._closure_solver.independent]
                found = find_equilibrium(
                    self.robot, self._beside, state.constrained_state, q, self._undriven, acceleration, state.wrenches
                )
                refuse_unbalanced(found, self.unactuated_joint_names)
                state, stable = replace(state, constrained_state=found.constrained_state), found.is_stable
            rest = np.zeros_like(state.q)
            sweep = run_forward_pass(state.robot, state.chart_q, rest, np.zeros(6), state.wrenches)
            forces, wrenches = inverse_dynamics(state.robot, sweep, rest, acceleration)
            forces = forces + spring_force(self.robot, state.q, rest)
            efforts = state.constrained_state.projected(forces)
            efforts[..., self._undriven] = 0
            if self.robot.loops:
                wrenches = compute_link_wrenches(state, rest, acceleration, forces)
        return Equilibrium(
            broadcast_result(state.q[..., self._closure_solver.independent], state.batch),
            broadcast_result(state.q, state.batch),
            broadcast_result(efforts, state.batch),
            broadcast_result(self._in_link_frames(wrenches), state.batch, axes=2),
            np.array(np.broadcast_to(stable, state.batch)),
        )

    def link_pose(self, name, q, *, base=None):
        """Pose (..., 4, 4) of a link frame in the world, which is frame 0 where the base is fixed."""
        frame, state = self.robot.frame(name), self._state(q, np.zeros(len(self.joint_names)), base)
        R, P = link_placements(self.robot, state.q)[frame.link]
        pose = np.zeros((*np.broadcast_shapes(R.shape[:-2], P.shape[:-1]), 4, 4))
        pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = R, P, 1
        return broadcast_result(state.base.pose @ pose @ frame.placement, state.batch, axes=2)

    def expand_positions(self, q, *, previous=None, velocities=None):
        """Positions of all joints, from those of the independent ones; loops are closed.

        Positions of dependent joints in q are a seed: the loops close at the positions next to it. The positions of the
        last sample of a motion are a seed that can fail: near a position where two assembly modes meet, as a flat
        parallelogram, the positions next to them may belong to the other mode. Give them as `previous`, and the
        velocities of that sample with them; or use `follow` for a whole trajectory.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions. Of all joints only without `previous`.
        previous : array_like, shape (..., all joints), optional
            Positions that close the loops, from which the motion leads to q.
        velocities : array_like, shape (..., all joints), optional
            Velocities at `previous`. The direction of motion on the branch; without them, that of its tangent.

        Returns
        -------
        ndarray, shape (..., all joints)

        Raises
        ------
        QuestionError
            An argument does not fit.
        SingularModelError
            The loops do not close, do not determine the dependent joints, or not without leaving the assembly mode.
        """
        if previous is None:
            if velocities is not None:
                raise InvalidInputError("velocities are those at previous positions: give previous too")
            return self._closure_solver.close_loops(q)
        return self._closure_solver.continue_branch(q, previous, velocities)

    @cached_property
    def platform(self):
        """The PlatformDynamics of a parallel robot: the same questions in coordinates of its platform; of all together
        where it has many.

        Raises QuestionError for a robot without a platform.
        """
        if not self.robot.platforms:
            raise InvalidInputError(f"{self.robot.name!r} has no platform: ask by joints")
        return PlatformDynamics(self, self.robot.platforms, single=len(self.robot.platforms) == 1)

    @cached_property
    def platforms(self):
        """{link: PlatformDynamics} of each platform alone, the rest of the robot being told by its joints. Another
        link raises QuestionError."""
        links, each = self.robot.platform_links, self.robot.platforms
        return Platforms({link: PlatformDynamics(self, (one,), single=True)
                          for link, one in zip(links, each, strict=True)})  # fmt: skip

    @cached_property
    def elastodynamics(self):
        """The Elastodynamics of a robot whose links bend, or whose joints are elastic: its natural frequencies at poses
        where motors and brakes hold it. Others may be held: `Elastodynamics(dynamics, held=[...])`."""
        return Elastodynamics(self)

    @cached_property
    def flexible_arm(self):
        """The FlexibleArm of a robot without loops whose links bend: inverse and direct dynamics, joints and elastic
        coordinates together. The other models take all links as rigid."""
        return FlexibleArm(self)

    @property
    def initial_joint_positions(self):
        """(all joints,) positions that close the loops, from the initial ones of the description."""
        return self._closure_solver.closed_positions

    def expand_trajectory(self, q):
        """Positions (N, all joints) of all joints along a trajectory q (N, n): the loops of each sample are closed from
        the sample before it, so that the assembly mode is kept wherever the trajectory leads. Where q has all joints,
        the first sample tells where to begin. What comes out is what the other methods take as q."""
        return self._closure_solver.close_trajectory(q)

    def expand_velocities(self, qd, q=None):
        """Velocities (..., all joints) of all joints, from those of the independent ones. q: as for `friction`.

        Those of yaw and roll of a platform are nan where pitch is ±90° and the motion has none.
        """
        qd, configuration = self._joints("velocities", qd), self._somewhere(q)
        with np.errstate(all="ignore"):
            found = configuration.expand_rates(qd)
        return configuration.joint_velocities(broadcast_result(found, found.shape[:-1]))

    def expand_accelerations(self, qdd, q=None, qd=None):
        """Accelerations (..., all joints) of all joints, from those of the independent ones.

        q, qd: where the robot has loops they have a part in it, else they may be left out.
        """
        configuration, qdd = self._somewhere(q), self._joints("accelerations", qdd)
        if self.robot.loops and qd is None:
            raise InvalidInputError("accelerations of joints in loops depend on velocities: give qd")
        if not self.robot.loops:
            return broadcast_result(configuration.expand_rates(qdd), qdd.shape[:-1])
        with np.errstate(all="ignore"):
            rates = configuration.expand_rates(self._joints("velocities", qd))
            found = configuration.expand_rates(qdd) + configuration.drift(rates)
        return configuration.joint_accelerations(rates, broadcast_result(found, found.shape[:-1]))

    def project_efforts(self, efforts, q=None):
        """What efforts (..., all joints) amount to on the independent joints (..., n). q: as for `friction`."""
        everyone = f"joints ({', '.join(self.all_joint_names)})"
        efforts, configuration = (
            require_finite("efforts", efforts, len(self.all_joint_names), everyone),
            self._somewhere(q),
        )
        return configuration.projected(configuration.chart_forces(efforts))

    def embed_efforts(self, efforts):
        """Efforts (..., all joints) that amount to `efforts` (..., n): nothing on joints that depend on others."""
        efforts = self._joints("efforts", efforts)
        spread = np.zeros((*efforts.shape[:-1], len(self.all_joint_names)))
        spread[..., self._closure_solver.independent] = efforts
        return spread

    def constrained_state(self, q):
        """The `newton_euler.configuration.Configuration` at positions as q: how all joints move together there."""
        return self._closure_solver.state_at(q)

    def _positions(self, q):
        """What programs take as q, checked: (..., n), or of all joints (..., all joints) where there are loops."""
        return self._closure_solver.close_loops(q) if self.robot.loops else self._joints("positions", q)

    def _somewhere(self, q):
        """The Configuration at q, or at any, where it makes no difference."""
        if q is None and self.robot.loops:
            raise InvalidInputError(f"{self.robot.name!r} has loops: this depends on positions, give q")
        return self._closure_solver.state_at(np.zeros(len(self.joint_names)) if q is None else q)

    def _beside(self, q, everyone):
        """The Configuration at positions q (..., n), near positions (..., all joints)."""
        near = np.array(np.broadcast_to(everyone, (*q.shape[:-1], everyone.shape[-1])))
        near[..., self._closure_solver.independent] = q
        try:
            return self._closure_solver.state_at(near if self.robot.loops else q, name_sample=False)
        except SingularModelError as error:
            raise SingularModelError(
                f"no equilibrium was found: the joints without motor move to where {error}"
            ) from None

    def _joints(self, what, values, ignored_columns=()):
        everyone = f"joints ({', '.join(self.joint_names)})"
        return require_finite(what, values, len(self.joint_names), everyone, ignored_columns)

    def _driven(self, what, values):
        """Accelerations or efforts that are given: of joints without motor neither can be."""
        why = "no motor drives it, so the acceleration is part of the answer and the effort is zero"
        return self._joints(
            what, values, {place: f"joint {self.joint_names[place]!r}: {why}" for place in self._undriven}
        )

    def _state(self, q, qd, base, external_wrenches=None, given=None):
        base, wrenches = base_state(self.robot, base), link_wrenches(self.robot, external_wrenches)
        use_charts = not virtual_links(self.robot) & {*wrenches}
        configuration, qd = self._closure_solver.state_at(q, use_charts=use_charts), self._joints("velocities", qd)
        told = (configuration.q, qd, given, base.gravity, base.twist, base.acceleration, *wrenches.values())
        batch = common_batch_shape(*told)
        return RobotState(configuration, configuration.expand_rates(qd), base, wrenches, batch, self.joint_names)

    def _bias(self, state, base, twist, acceleration):
        if base is not None and base.acceleration is not None:
            raise InvalidInputError("the acceleration of the base has no part in this term: leave it out of Base")
        with np.errstate(all="ignore"):
            H = bias(state.robot, state.chart_q, state.qd, twist, acceleration, drift=state.drift)
            return broadcast_result(
                apply_transposed(projection_matrix(state.constrained_state.G, self._base_rows), H), state.batch
            )

    def _in_link_frames(self, wrenches):
        """Wrenches (..., 1 + joints, 6) in frames j, expressed in the link frames that the description gives."""
        moved = [wrench_to_antecedent(R, P, wrenches[..., j, :]) for j, (R, P) in enumerate(self._in_link_frame)]
        return np.stack(moved, axis=-2)
