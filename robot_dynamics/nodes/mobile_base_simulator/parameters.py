"""The parameters of mobile_base_simulator: what they are, and the Simulation that they amount to."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.dynamics import Base
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.geometry import QUATERNION_NORM_TOLERANCE
from robot_dynamics.nodes.parameters import convert_parameter, parse_integer, parse_names, parse_numbers
from robot_dynamics.simulation import Ground, Simulation, Wheel

# name: (default, what it is)
PARAMETERS = {
    "step": (0.001, "of the integration [s]"),
    "real_time_factor": (1.0, "simulated seconds in a second; 0: as many as the machine manages"),
    "publish_clock": (True, "publish /clock, and stamp messages with simulated time; else with the time of the node"),
    "start_paused": (False, "wait for ~/pause or ~/step"),
    "wait_for_commands": (
        "never",
        "never; first: time stands still until the first efforts come; each: each efforts let it go on by a step, so "
        "that where the machine is too slow no state goes unanswered",
    ),
    "moved_by": ("efforts", "efforts, or reference: joints move as ~/reference tells, and the base by reaction"),
    "base_motion": ("", "fixed, free or planar; empty: as the description says, planar where there are wheels"),
    "wheels.joints": ("", "names of the joints that wheels turn about"),
    "wheels.radii": ("", "of the wheels [m]"),
    "wheels.roller_angles": ("", "of rollers on the rims [rad], for omnidirectional and mecanum wheels; empty: none"),
    "drive_time": (0.05, "in which cmd_vel comes 63 % nearer [s]"),
    "ground.points": ("", "names of links whose origins touch the ground; empty: there is no ground"),
    "ground.height": (0.0, "z of the ground in the world [m]"),
    "ground.stiffness": (2e4, "of the ground below each point [N/m]; what hits it goes in by about v √(m/k)"),
    "ground.damping": (2e2, "of the ground below each point [N s/m]"),
    "ground.friction": (0.8, "of the ground"),
    "ground.slip_velocity": (0.01, "at which friction has 0.7 of its full value [m/s]"),
    "joints": ("", "names of the joints in the order of ~/commands; empty: all that have motors"),
    "initial.joints": ("", "names of the joints that initial.positions and initial.velocities are of"),
    "initial.positions": (
        "",
        "of these joints [rad or m]; of the others as the description begins, or in the middle of their limits where "
        "it does not say and zero is beyond them",
    ),
    "initial.velocities": ("", "of these joints [rad/s or m/s]; empty: at rest"),
    "initial.pose": ([0.0] * 6 + [1.0], "of the base in the world: x, y, z [m], quaternion x, y, z, w"),
    "initial.twist": ([0.0] * 6, "of the base, in its own frame: linear [m/s], angular [rad/s]"),
    "command_timeout": (0.1, "simulated time after which commands and wrenches that stopped are zero [s]"),
    "stamped_cmd_vel": (False, "cmd_vel is TwistStamped, and not Twist"),
    "odom_rate": (50.0, "of odom, /tf and ~/base_acceleration [1/s of simulated time]"),
    "odom_frame": ("odom", "frame of the world in odom and /tf"),
    "base_frame": ("", "frame of the base in odom and /tf; empty: the name of its link"),
    "noise.position": (0.0, "standard deviation of positions in joint_states [rad or m]"),
    "noise.velocity": (0.0, "standard deviation of velocities in joint_states [rad/s or m/s]"),
    "seed": (0, "of the noise, which begins anew at each reset"),
}
NAMES = ("wheels.joints", "ground.points", "joints", "initial.joints")
NUMBERS = ("wheels.radii", "wheels.roller_angles", "initial.positions", "initial.velocities")
POSITIVE = ("step", "drive_time", "command_timeout")
NONNEGATIVE = ("real_time_factor", "odom_rate", "noise.position", "noise.velocity")
# what can change without another Simulation
RUNTIME_PARAMETERS = (
    *NONNEGATIVE,
    *("publish_clock", "start_paused", "wait_for_commands", "command_timeout", "odom_frame", "base_frame"),
)
STARTUP_PARAMETERS = ("stamped_cmd_vel",)  # what is read when the node begins
CHOICES = {"moved_by": ("efforts", "reference"), "wait_for_commands": ("never", "first", "each")}


def validate_parameter(name, value):
    """The value of a parameter in its type. Raises QuestionError."""
    default, description = PARAMETERS[name]
    if name in NAMES:
        return parse_names(name, value)
    if name in NUMBERS:
        return parse_numbers(name, value, description)
    if name == "seed":
        return parse_integer(name, value, least=0)
    value = convert_parameter(default, name, value, description)
    if (name in POSITIVE and not 0 < value < np.inf) or (name in NONNEGATIVE and not 0 <= value < np.inf):
        least = "more than 0" if name in POSITIVE else "0 or more"
        raise InvalidInputError(f"parameter {name} is {value:g}: {least} is needed, {description}")
    if name in CHOICES and value not in CHOICES[name]:
        raise InvalidInputError(f"parameter {name} is {value!r}: {' or '.join(CHOICES[name])} is right")
    return value


@dataclass(frozen=True, eq=False)
class SimulationSetup:
    """A Simulation at its beginning, and joints (k,): places in its joint_names of those that ~/commands has."""

    simulation: Simulation
    joints: np.ndarray
    joint_names: tuple


def build_simulation(values, robot):
    """The Simulated of parameters {name: checked value} and a robot. Raises RobotDynamicsError."""
    joints, angles = values["wheels.joints"], values["wheels.roller_angles"]
    _alike("wheels.radii", values["wheels.radii"], "wheels.joints", joints)
    if angles:
        _alike("wheels.roller_angles", angles, "wheels.joints", joints)
    rolled = zip(joints, values["wheels.radii"], angles or [None] * len(joints), strict=True)
    wheels = [Wheel(name, radius, angle) for name, radius, angle in rolled]
    ground = None
    if values["ground.points"]:
        ground = Ground(**{name: values[f"ground.{name}"] for name in Ground.__dataclass_fields__})
    settings = {"step": values["step"], "drive_time": values["drive_time"], "base": values["base_motion"] or None}
    simulation = Simulation(robot, wheels=wheels, ground=ground, **settings)
    _start(simulation, values)
    unactuated = simulation.dynamics.unactuated_joint_names
    driven = [name for name in simulation.joint_names if name not in unactuated]
    for name in values["joints"]:
        if name not in driven:
            raise InvalidInputError(f"parameter joints: {name!r} has no motor; {', '.join(driven)} have")
    if len(set(values["joints"])) < len(values["joints"]):
        raise InvalidInputError("parameter joints names a joint more than once")
    chosen = tuple(values["joints"] or driven)
    return SimulationSetup(
        simulation, np.array([simulation.joint_names.index(name) for name in chosen], dtype=int), chosen
    )


def _start(simulation, values):
    joints = values["initial.joints"]
    start, places = simulation.state, []
    for name in joints:
        if name not in simulation.joint_names:
            raise InvalidInputError(
                f"parameter initial.joints: {name!r} is none of the joints {', '.join(simulation.joint_names)}"
            )
        places.append(simulation.joint_names.index(name))
    if joints and not (values["initial.positions"] or values["initial.velocities"]):
        raise InvalidInputError(
            "parameter initial.joints has names, but neither initial.positions nor initial.velocities"
        )
    initial = {"positions": initial_positions(simulation), "velocities": start.velocities.copy()}
    for what, array in initial.items():
        told = values[f"initial.{what}"]
        if told:
            _alike(f"initial.{what}", told, "initial.joints", joints)
            array[places] = told
    pose, quaternion = np.eye(4), np.array(values["initial.pose"][3:])
    if not abs(np.linalg.norm(quaternion) - 1) < QUATERNION_NORM_TOLERANCE:
        raise InvalidInputError(
            f"parameter initial.pose has a quaternion of norm {np.linalg.norm(quaternion):g}, not 1"
        )
    pose[:3, :3], pose[:3, 3] = Rotation.from_quat(quaternion).as_matrix(), values["initial.pose"][:3]
    simulation.start(**initial, base=Base(pose, values["initial.twist"]))


def initial_positions(simulation):
    """Positions (n,) at which the joints of a Simulation begin where no parameter says it.

    They are those of the description. Where it gives none and zero is beyond the limits of the joint, the joint begins
    in their middle, or at the limit where there is one alone, as joint_state_publisher has it.
    """
    robot, positions = simulation.robot, simulation.state.positions.copy()
    for place, name in enumerate(simulation.joint_names):
        number = robot.joint_numbers[name]
        joint = robot.joints[number]
        lower, upper = joint.limits.lower, joint.limits.upper
        if positions[place] or lower <= 0 <= upper or lower > upper or number in robot.joints_in_loops or joint.spring:
            continue
        middle = (lower + upper) / 2
        positions[place] = middle if np.isfinite(middle) else lower if lower > 0 else upper
    return positions


def _alike(name, values, other, names):
    if len(values) != len(names):
        raise InvalidInputError(f"parameter {name} has {len(values)} values and {other} {len(names)}: one for each")


def joint_limit_warnings(simulation):
    """Sentences on joints that are beyond the limits of their description."""
    for name, position in zip(simulation.joint_names, simulation.state.positions, strict=True):
        limits = simulation.robot.joints[simulation.robot.joint_numbers[name]].limits
        if not limits.lower <= position <= limits.upper:
            yield (
                f"joint {name!r} begins at {position:.6g}, its limits are {limits.lower:.6g} and {limits.upper:.6g}: "
                "set initial.joints and initial.positions. Limits stop nothing here"
            )
