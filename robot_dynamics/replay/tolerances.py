"""What is tolerated, from a YAML file; the one that ships is the default."""

import json
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from robot_dynamics.errors import DescriptionError, unknown_name
from robot_dynamics.model.formats.text import read_path
from robot_dynamics.model.formats.yaml_document import YamlDocument, validator_of
from robot_dynamics.model.library import shipped_file

LARGEST = 1024 * 1024
NEED = "a YAML file of tolerances"


@dataclass(frozen=True)
class Tolerances:
    """See config/tolerances/default.yaml for what each number means. joints: {joint: {key: number}} that differ."""

    normalised_rms: float
    effort_share: float
    window_factor: float
    joints: dict = field(default_factory=dict)

    def rms(self, joint, spread, limit):
        """The RMS of residuals [N m or N] that is tolerated of a joint: its spread of measured efforts, its limit."""
        told = self.joints.get(joint, {})
        normalised, share = (told.get(key, getattr(self, key)) for key in ("normalised_rms", "effort_share"))
        return max(normalised * spread, share * limit)


def load_tolerances(path=None, joint_names=None):
    """The Tolerances of a YAML file, where it does not tell those that ship; None: those. Raises DescriptionError.

    joint_names: of the robot, None where any name may stand.
    """
    told = _read(shipped_file("tolerances/default.yaml")).data
    if path is not None:
        document = _read(Path(path))
        for name in document.data.get("joints", {}):
            if joint_names is not None and name not in joint_names:
                document.fail(("joints", name), unknown_name("joint", name, joint_names))
        told = {**told, **document.data}
    return Tolerances(**{key: value for key, value in told.items() if key != "format"})


def _read(path):
    document = YamlDocument(read_path(path, LARGEST), path, NEED)
    if not isinstance(document.data, dict):
        raise DescriptionError(f"{path}: {NEED} is needed: `format: 1`, and what it tells")
    document.validate(_validator())
    return document


@cache
def _validator():
    return validator_of(json.loads(Path(__file__).with_name("tolerances.schema.json").read_text(encoding="utf-8")))
