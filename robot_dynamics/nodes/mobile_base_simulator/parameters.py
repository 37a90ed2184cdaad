"""The parameters of mobile_base_simulator."""

from robot_dynamics.nodes.parameters import ParameterSpec, by_name

PARAMETERS = by_name(
    ParameterSpec("step", 0.001, "integration step [s]", lower_bound=1e-6, upper_bound=1.0, read_at="configuration"),
    ParameterSpec("real_time_factor", 1.0, "simulated seconds per second; 0: as fast as possible", lower_bound=0.0),
    ParameterSpec(
        "publish_clock", True, "publish /clock and stamp messages with simulated time; false: with the time of the node"
    ),
    ParameterSpec("start_paused", False, "wait for ~/pause or ~/step"),
    ParameterSpec(
        "wait_for_commands",
        "never",
        "never; first: time stands still until the first efforts arrive; each: efforts advance time"
        " by one step, so that a slow machine skips no state",
        choices=("never", "first", "each"),
    ),
    ParameterSpec(
        "moved_by",
        "efforts",
        "efforts, or reference: the joints follow ~/reference, and the base moves by reaction",
        choices=("efforts", "reference"),
        read_at="configuration",
    ),
    ParameterSpec(
        "base_motion",
        "",
        "fixed, free or planar; empty: as in the description, planar where there are wheels",
        read_at="configuration",
    ),
    ParameterSpec("wheels.joints", "", "names of the joints of the wheels", list_kind="names", read_at="configuration"),
    ParameterSpec(
        "wheels.radii",
        "",
        "radii of the wheels [m]",
        list_kind="numbers",
        lower_bound=1e-3,
        upper_bound=1e3,
        read_at="configuration",
    ),
    ParameterSpec(
        "wheels.roller_angles",
        "",
        "angles of the rollers on the rims [rad], for omnidirectional and mecanum wheels; empty: none",
        list_kind="numbers",
        read_at="configuration",
    ),
    ParameterSpec(
        "drive_time",
        0.05,
        "time constant with which the base follows cmd_vel [s]",
        lower_bound=0.0,
        is_bound_excluded=True,
        read_at="configuration",
    ),
    ParameterSpec(
        "ground.points",
        "",
        "names of links whose origins touch the ground; empty: there is no ground",
        list_kind="names",
        read_at="configuration",
    ),
    ParameterSpec("ground.height", 0.0, "z of the ground in the world [m]", read_at="configuration"),
    ParameterSpec(
        "ground.stiffness",
        2e4,
        "stiffness of the ground below each point [N/m]; an impact penetrates by about v √(m/k)",
        read_at="configuration",
    ),
    ParameterSpec("ground.damping", 2e2, "damping of the ground below each point [N s/m]", read_at="configuration"),
    ParameterSpec("ground.friction", 0.8, "friction coefficient of the ground", read_at="configuration"),
    ParameterSpec(
        "ground.slip_velocity",
        0.01,
        "slip velocity at which friction has 0.7 of its full value [m/s]",
        read_at="configuration",
    ),
    ParameterSpec(
        "joints",
        "",
        "names of the joints in the order of ~/commands; empty: all that have motors",
        list_kind="names",
        read_at="configuration",
    ),
    ParameterSpec(
        "initial.joints",
        "",
        "names of the joints of initial.positions and initial.velocities",
        list_kind="names",
        read_at="configuration",
    ),
    ParameterSpec(
        "initial.positions",
        "",
        "positions of these joints [rad or m]; other joints start at the position of the "
        "description, or in the middle of their limits if it has none and zero is beyond them",
        list_kind="numbers",
        read_at="configuration",
    ),
    ParameterSpec(
        "initial.velocities",
        "",
        "velocities of these joints [rad/s or m/s]; empty: at rest",
        list_kind="numbers",
        read_at="configuration",
    ),
    ParameterSpec(
        "initial.pose",
        [0.0] * 6 + [1.0],
        "pose of the base in the world: x, y, z [m], quaternion x, y, z, w",
        read_at="configuration",
    ),
    ParameterSpec(
        "initial.twist",
        [0.0] * 6,
        "twist of the base in its frame: linear [m/s], angular [rad/s]",
        read_at="configuration",
    ),
    ParameterSpec(
        "command_timeout",
        0.1,
        "simulated time after which commands and wrenches that are not repeated are zero [s]",
        lower_bound=0.0,
        is_bound_excluded=True,
    ),
    ParameterSpec("stamped_cmd_vel", False, "cmd_vel is TwistStamped, and not Twist", read_at="startup"),
    ParameterSpec(
        "odom_rate", 50.0, "rate of odom, /tf and ~/base_acceleration [1/s of simulated time]", lower_bound=0.0
    ),
    ParameterSpec("odom_frame", "odom", "frame of the world in odom and /tf"),
    ParameterSpec("base_frame", "", "frame of the base in odom and /tf; empty: the name of its link"),
    ParameterSpec("noise.position", 0.0, "standard deviation of positions in joint_states [rad or m]", lower_bound=0.0),
    ParameterSpec(
        "noise.velocity", 0.0, "standard deviation of velocities in joint_states [rad/s or m/s]", lower_bound=0.0
    ),
    ParameterSpec("seed", 0, "seed of the noise, which restarts at each reset", lower_bound=0, read_at="configuration"),
)


def validate_parameter(name: str, value: object) -> object:
    """Return the value of a parameter in its type. Raises InvalidInputError."""
    return PARAMETERS[name].validate(value)
