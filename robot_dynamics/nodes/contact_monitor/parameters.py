"""The parameters of contact_monitor."""

from robot_dynamics.nodes.parameters import ParameterSpec, by_name

UPPER_BOUND = 1e6  # [s or 1/s] values from here on are refused

PARAMETERS = by_name(
    ParameterSpec(
        "effort_topic",
        "",
        "topic (JointState) of the efforts, such as that of a controller; empty: the efforts in joint_states",
        read_at="startup",
    ),
    ParameterSpec(
        "drives",
        "",
        "path of a YAML file: gains and offsets of efforts; see config/drives. Motors have the names of their joints",
        read_at="configuration",
    ),
    ParameterSpec(
        "thresholds",
        "",
        "path of a YAML file that the verb contact-thresholds writes; empty: effort_share of the effort limits",
        read_at="configuration",
    ),
    ParameterSpec(
        "effort_share",
        0.1,
        "threshold of a joint without a file of thresholds, relative to its effort limit",
        lower_bound=0.0,
        is_bound_excluded=True,
        upper_bound=UPPER_BOUND,
        read_at="configuration",
    ),
    ParameterSpec(
        "bandwidth",
        0.0,
        "bandwidth of the observer [1/s]: external efforts show after 1 / bandwidth; 0: that of the thresholds, or 50",
        lower_bound=0.1,
        upper_bound=UPPER_BOUND,
        special_values=(0.0,),
        read_at="configuration",
    ),
    ParameterSpec(
        "max_gap",
        0.1,
        "time between two stamps beyond which the observer restarts [s]",
        lower_bound=1e-3,
        upper_bound=UPPER_BOUND,
        read_at="configuration",
    ),
    ParameterSpec(
        "release_ratio",
        0.7,
        "part of the thresholds below which a collision ends",
        lower_bound=0.0,
        is_bound_excluded=True,
        upper_bound=1.0,
        read_at="configuration",
    ),
    ParameterSpec(
        "release_time",
        0.2,
        "how long efforts are below that part before a collision ends [s]",
        lower_bound=0.0,
        upper_bound=UPPER_BOUND,
        read_at="configuration",
    ),
    ParameterSpec(
        "frame",
        "",
        "frame at whose origin the external wrench acts; empty: no wrench is computed",
        read_at="configuration",
    ),
    ParameterSpec(
        "wrench",
        "wrench",
        "what is solved for at the frame: a wrench of six components, or a force without a torque",
        choices=("wrench", "force"),
        read_at="configuration",
    ),
    ParameterSpec(
        "state_timeout",
        1.0,
        "time without joint_states, odom or efforts after which they are stale [s]",
        lower_bound=1e-3,
        upper_bound=UPPER_BOUND,
    ),
)
