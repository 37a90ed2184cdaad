"""Tolerances of checks, from a YAML file; the default is `config/tolerances/default.yaml`."""

from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

from robot_dynamics.errors import describe_unknown_name
from robot_dynamics.model.loading import shipped_file
from robot_dynamics.recordings.documents import read_document

SCHEMA = Path(__file__).with_name("tolerances.schema.json")
EXPECTED = "a YAML file of tolerances"


@dataclass(frozen=True)
class Tolerances:
    """Tolerated residuals.

    Attributes
    ----------
    normalised_rms : tolerated RMS of the residual as a part of the spread of the measured effort; or
    effort_share : as a part of the effort limit of the joint: the larger of the two is tolerated.
    window_factor : factor on the tolerated RMS for a single window of one second.
    joints : {joint: {normalised_rms, effort_share}} where a joint differs.
    """

    normalised_rms: float
    effort_share: float
    window_factor: float
    joints: dict[str, dict[str, float]] = field(default_factory=dict)

    def rms_tolerance(self, joint: str, spread: float, limit: float) -> float:
        """Tolerated RMS of the residual of a joint [N m or N].

        Parameters
        ----------
        joint : name.
        spread : standard deviation of its measured effort [N m or N].
        limit : its effort limit [N m or N].
        """
        overrides = self.joints.get(joint, {})
        normalised_rms = overrides.get("normalised_rms", self.normalised_rms)
        effort_share = overrides.get("effort_share", self.effort_share)
        return max(normalised_rms * spread, effort_share * limit)


def load_tolerances(path: str | Path | None = None, joint_names: Collection[str] | None = None) -> Tolerances:
    """Read tolerances from a YAML file.

    Parameters
    ----------
    path : path of the file, whose keys replace those of the default; None: the default.
    joint_names : names of the joints of the robot; None: names are not checked.

    Raises
    ------
    DescriptionError
        Where the file cannot be read, or does not fit its schema or the joints.
    """
    default = shipped_file("tolerances/default.yaml")
    assert default is not None, "the package ships this file"
    values = read_document(default, SCHEMA, EXPECTED).data
    if path is not None:
        document = read_document(Path(path), SCHEMA, EXPECTED)
        for name in document.data.get("joints", {}):
            if joint_names is not None and name not in joint_names:
                document.fail(("joints", name), describe_unknown_name("joint", name, joint_names))
        values = {**values, **document.data}
    return Tolerances(**{key: value for key, value in values.items() if key != "format"})
