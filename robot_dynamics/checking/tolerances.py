"""Tolerances of checks, from a YAML file; those that ship are quick, normal and strict in `config/tolerances`."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.loading import shipped_file
from robot_dynamics.recordings.documents import read_document

if TYPE_CHECKING:
    from robot_dynamics.checking.comparison import JointComparison

SCHEMA = Path(__file__).with_name("tolerances.schema.json")
EXPECTED = "a YAML file of tolerances"
SHIPPED = ("quick", "normal", "strict")
DEFAULT = "normal"


@dataclass(frozen=True)
class Tolerances:
    """What is tolerated.

    The RMS of the residual of a joint has three parts, whose squares add up: errors of the model (the larger of the
    first two attributes), noise and accuracy of the measurement (the next two).

    Attributes
    ----------
    normalised_rms : part of the spread (standard deviation) of the measured effort; of its RMS where the joint moves in
        one direction only.
    relative_rms : part of the RMS of the measured effort, mean included.
    noise_factor : factor on the noise of the measured effort.
    effort_share : part of the effort limit of the joint.
    min_correlation : least correlation of measured and predicted effort.
    max_scale_error : largest difference of the scale from 1, beside its uncertainty.
    window_factor : factor on the tolerated RMS for a single window of one second.
    min_coverage : least part of the recording that is compared, 0 to 1.
    joints : {joint: {attribute: value}} where a joint differs; the attributes down to `max_scale_error`.
    """

    normalised_rms: float
    relative_rms: float
    noise_factor: float
    effort_share: float
    min_correlation: float
    max_scale_error: float
    window_factor: float
    min_coverage: float
    joints: dict[str, dict[str, float]] = field(default_factory=dict)

    def rms_tolerance(self, joint: JointComparison, limit: float) -> float:
        """Tolerated RMS of the residual of a joint [N m or N]; nan for a joint without samples.

        limit: its effort limit [N m or N].
        """
        name = joint.joint
        noise = self.of_joint("noise_factor", name) * joint.noise
        accuracy = self.of_joint("effort_share", name) * limit
        return math.hypot(self.model_tolerance(joint), noise, accuracy)

    def model_tolerance(self, joint: JointComparison) -> float:
        """The part of the tolerated RMS of a joint that errors of the model may have [N m or N]."""
        spread = joint.effort_rms if joint.moves_one_way else joint.spread
        return max(
            self.of_joint("normalised_rms", joint.joint) * spread,
            self.of_joint("relative_rms", joint.joint) * joint.effort_rms,
        )

    def of_joint(self, key: str, joint: str) -> float:
        """The value of an attribute for a joint."""
        value: float = self.joints.get(joint, {}).get(key, getattr(self, key))
        return value


def load_tolerances(path: str | Path | None = None, joint_names: Collection[str] | None = None) -> Tolerances:
    """Read tolerances from a YAML file.

    Parameters
    ----------
    path : path of the file, whose keys replace those of `normal`; or one of `SHIPPED`; None: `normal`.
    joint_names : names of the joints of the robot; None: names are not checked.

    Raises
    ------
    DescriptionError
        Where the file cannot be read, or does not fit its schema or the joints.
    """
    values = read_document(_shipped_path(DEFAULT), SCHEMA, EXPECTED).data
    if path is not None:
        if path not in SHIPPED and not Path(path).exists():
            raise DescriptionError(
                f"tolerances {str(path)!r}: no such file. Name {', '.join(SHIPPED[:-1])} or {SHIPPED[-1]}, or a YAML "
                "file of your own"
            )
        document = read_document(_shipped_path(str(path)) if path in SHIPPED else Path(path), SCHEMA, EXPECTED)
        for name in document.data.get("joints", {}):
            if joint_names is not None and name not in joint_names:
                document.fail(("joints", name), describe_unknown_name("joint", name, joint_names))
        values = {**values, **document.data}
    return Tolerances(**{key: value for key, value in values.items() if key != "format"})


def _shipped_path(name: str) -> Path:
    path = shipped_file(f"tolerances/{name}.yaml")
    assert path is not None, "the package ships this file"
    return path
