"""The parameters of joint_state_completer."""

from robot_dynamics.nodes.parameters import ParameterSpec, by_name

UPPER_BOUND = 1e9  # values from here on are refused

PARAMETERS = by_name(
    ParameterSpec(
        "use_passive_positions",
        True,
        "whether positions of passive joints in messages choose the assembly mode. Set it to false where they mean "
        "nothing, as those of joint_state_publisher_gui",
    ),
    ParameterSpec("state_timeout", 1.0, "time without joint_states after which they are stale [s]", lower_bound=0.1),
    ParameterSpec("frame_prefix", "", "text before the names of links in markers, as of robot_state_publisher"),
    ParameterSpec("markers.rate", 10.0, "maximum rate of markers [1/s]; 0: no markers", lower_bound=0.0),
    ParameterSpec(
        "markers.efforts",
        "gravity",
        "joint efforts that arrows show: those that hold the robot at rest, those of the messages, or none",
        choices=("gravity", "measured", "none"),
    ),
    ParameterSpec(
        "markers.length",
        0.3,
        "length of an arrow at the effort limit of its joint, or at the reference force or torque [m]",
        lower_bound=0.0,
        is_bound_excluded=True,
        upper_bound=UPPER_BOUND,
    ),
    ParameterSpec(
        "markers.force",
        100.0,
        "reference of external forces, and of prismatic joints without effort limit [N]",
        lower_bound=0.0,
        is_bound_excluded=True,
        upper_bound=UPPER_BOUND,
    ),
    ParameterSpec(
        "markers.torque",
        100.0,
        "reference of external torques, and of revolute joints without effort limit [N m]",
        lower_bound=0.0,
        is_bound_excluded=True,
        upper_bound=UPPER_BOUND,
    ),
    ParameterSpec(
        "markers.density",
        2700.0,
        "density of the spheres at centres of mass, which have the mass of their links [kg/m^3]",
        lower_bound=0.0,
        is_bound_excluded=True,
        upper_bound=UPPER_BOUND,
    ),
)
