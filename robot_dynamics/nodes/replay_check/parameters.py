"""The parameters of replay_check."""

from robot_dynamics.checking.live_check import DEFAULT_SPAN
from robot_dynamics.nodes.parameters import ParameterSpec, by_name

UPPER_BOUND = 1e6  # [s or 1/s] values from here on are refused

PARAMETERS = by_name(
    ParameterSpec(
        "topics",
        "",
        "names of the topics with joint states; empty: joint_states",
        list_kind="names",
        read_at="startup",
    ),
    ParameterSpec(
        "drives",
        "",
        "path of a YAML file: motors and their ratios, gains, offsets; see config/drives",
        read_at="configuration",
    ),
    ParameterSpec("tolerances", "normal", "quick, normal, strict, or the path of a YAML file", read_at="configuration"),
    ParameterSpec(
        "cutoff",
        0.0,
        "cut-off frequency of the low-pass filter [Hz]; 0: 8, or a fifth of the rate",
        lower_bound=0.1,  # a lower cut-off would keep minutes of samples
        upper_bound=UPPER_BOUND,
        special_values=(0.0,),
        read_at="configuration",
    ),
    ParameterSpec(
        "rate",
        0.0,
        "rate to which signals are resampled [1/s]; 0: that of the messages",
        lower_bound=0.1,
        upper_bound=UPPER_BOUND,
        special_values=(0.0,),
        read_at="configuration",
    ),
    ParameterSpec(
        "span",
        DEFAULT_SPAN,
        "time span of a verdict [s]",
        lower_bound=1.0,
        upper_bound=UPPER_BOUND,
        read_at="configuration",
    ),
    ParameterSpec(
        "stale_after",
        1.0,
        "time without messages on a joint after which it is stale [s]",
        lower_bound=0.1,
        upper_bound=UPPER_BOUND,
        read_at="configuration",
    ),
)
