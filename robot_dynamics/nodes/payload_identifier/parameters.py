"""The parameters of payload_identifier."""

from robot_dynamics.identification.determination import EFFORT_ACCURACY
from robot_dynamics.nodes.parameters import ParameterSpec, by_name

UPPER_BOUND = 1e6  # [Hz] values from here on are refused

PARAMETERS = by_name(
    ParameterSpec(
        "topics",
        "",
        "names of the topics with joint states; empty: joint_states",
        list_kind="names",
        read_at="startup",
    ),
    ParameterSpec("drives", "", "path of a YAML file: motors and their ratios, gains, offsets; see config/drives"),
    ParameterSpec(
        "link", "", "link that carries the load where a request names none; empty: the last one of the description"
    ),
    ParameterSpec(
        "cutoff",
        0.0,
        "cut-off frequency of the low-pass filter [Hz]; 0: 8, or a fifth of the rate",
        lower_bound=0.1,
        upper_bound=UPPER_BOUND,
        special_values=(0.0,),
    ),
    ParameterSpec(
        "band",
        0.0,
        "cut-off frequency of the filter of efforts and regressor [Hz]; 0: cutoff, at most 10",
        lower_bound=0.1,
        upper_bound=UPPER_BOUND,
        special_values=(0.0,),
    ),
    ParameterSpec(
        "effort_accuracy",
        EFFORT_ACCURACY,
        "relative standard deviation of the scale of the measured efforts, which no measurement shows",
        lower_bound=0.0,
        upper_bound=1.0,
    ),
    ParameterSpec(
        "max_duration",
        120.0,
        "longest measurement that a request may ask for [s]",
        lower_bound=0.0,
        is_bound_excluded=True,
        upper_bound=3600.0,
    ),
)
