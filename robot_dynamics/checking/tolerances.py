"""What is tolerated, from a YAML file; the one that ships is the default."""

from dataclasses import dataclass, field
from pathlib import Path

from robot_dynamics.errors import describe_unknown_name
from robot_dynamics.model.loading import shipped_file
from robot_dynamics.recordings.documents import read_document

SCHEMA = Path(__file__).with_name("tolerances.schema.json")
EXPECTED = "a YAML file of tolerances"


@dataclass(frozen=True)
class Tolerances:
    """See config/tolerances/default.yaml for what each number means. joints: {joint: {key: number}} that differ."""

    normalised_rms: float
    effort_share: float
    window_factor: float
    joints: dict = field(default_factory=dict)

    def rms_tolerance(self, joint, spread, limit):
        """The RMS of residuals [N m or N] that is tolerated of a joint: its spread of measured efforts, its limit."""
        told = self.joints.get(joint, {})
        normalised, share = (told.get(key, getattr(self, key)) for key in ("normalised_rms", "effort_share"))
        return max(normalised * spread, share * limit)


def load_tolerances(path=None, joint_names=None):
    """The Tolerances of a YAML file, where it does not tell those that ship; None: those. Raises DescriptionError.

    joint_names: of the robot, None where any name may stand.
    """
    told = read_document(shipped_file("tolerances/default.yaml"), SCHEMA, EXPECTED).data
    if path is not None:
        document = read_document(Path(path), SCHEMA, EXPECTED)
        for name in document.data.get("joints", {}):
            if joint_names is not None and name not in joint_names:
                document.fail(("joints", name), describe_unknown_name("joint", name, joint_names))
        told = {**told, **document.data}
    return Tolerances(**{key: value for key, value in told.items() if key != "format"})
