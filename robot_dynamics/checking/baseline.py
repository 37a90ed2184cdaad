"""Two checks of the same recordings, or of recordings of the same motion: which joints became worse.

A joint is worse if the RMS of its residual, or the error of its scale, grew by more than a stated amount and twice the
standard deviation of the difference. Where both checks compared the same measured efforts, the difference of the RMS
has no scatter.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_dynamics.errors import RecordingError

MAX_RMS_INCREASE = 0.1  # part of the former RMS
MIN_RMS_INCREASE = 0.01  # part of the spread of the measured effort
MAX_SCALE_INCREASE = 0.02  # of the difference of the scale from 1
DEVIATIONS = 2.0  # standard deviations of a difference that are added
MAX_SPREAD_CHANGE = 0.1  # part of the former spread, beside the RMS of the residual, of recordings of the same motion
MAX_NAMES = 3  # listed in one note
SAME_DATA = 1e-9  # relative difference of spreads up to which two checks compared the same efforts

JointValues = Mapping[str, Any]  # of a joint in the JSON of a check


@dataclass(frozen=True)
class JointChange:
    """A joint in two checks.

    Attributes
    ----------
    recording, joint : names.
    verdict_before, verdict : passed, failed or not judged.
    rms_before, rms : of the residual [N m or N]; None where the joint never moves.
    tolerated_increase : of the RMS [N m or N].
    scale_before, scale : factors from predicted to measured effort; None where unknown.
    reasons : sentences on why it is worse; empty where it is not.
    """

    recording: str
    joint: str
    verdict_before: str
    verdict: str
    rms_before: float | None
    rms: float | None
    tolerated_increase: float
    scale_before: float | None
    scale: float | None
    reasons: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """Plain data for JSON."""
        return {**asdict(self), "reasons": list(self.reasons), "worse": bool(self.reasons)}


class Baseline:
    """The results of an earlier check, from its JSON file.

    Raises
    ------
    RecordingError
        Where the file cannot be read, or is no result of replay-check.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            recordings = json.loads(self.path.read_text(encoding="utf-8"))["recordings"]
            self._recordings: dict[str, dict[str, JointValues]] = {
                entry["recording"]: {joint["joint"]: joint for joint in entry["joints"]}
                for entry in recordings
                if "joints" in entry
            }
        except OSError as error:
            raise RecordingError(f"--baseline {path} cannot be read: {error.strerror}") from None
        except (ValueError, KeyError, TypeError):
            raise RecordingError(
                f"--baseline {path} is no result of replay-check: a file that --json of replay-check wrote is needed"
            ) from None
        if not self._recordings:
            raise RecordingError(f"--baseline {path} has no recording that was checked")

    def compare(self, results: Sequence[Mapping[str, Any]]) -> tuple[list[JointChange], list[str]]:
        """Compare results of recordings, in the form of the JSON file.

        Recordings are matched by their names; where both checks have one recording, these are compared.

        Returns
        -------
        changes : of the joints that are in both.
        notes : sentences on recordings that are not in the baseline, and on those of another motion.
        """
        checked = [result for result in results if "joints" in result]
        changes: list[JointChange] = []
        missing: list[str] = []
        notes: list[str] = []
        for result in checked:
            before = self._recordings.get(result["recording"])
            if before is None and len(checked) == 1 and len(self._recordings) == 1:
                (before,) = self._recordings.values()
            if before is None:
                missing.append(result["recording"])
                continue
            notes += _notes_on_motion(result, before)
            changes += [
                _compare_joint(result["recording"], before[joint["joint"]], joint)
                for joint in result["joints"]
                if joint["joint"] in before
            ]
        return changes, [*self._notes_on_missing(missing), *notes]

    def _notes_on_missing(self, recordings: Sequence[str]) -> Iterator[str]:
        if recordings:
            verb = "is" if len(recordings) == 1 else "are"
            yield (
                f"{_list_names(recordings)} {verb} not in the baseline {self.path}, and not compared with it. It has "
                f"{_list_names(list(self._recordings))}"
            )


def _list_names(names: Sequence[str]) -> str:
    more = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {more} more" if more > 0 else "")


def _notes_on_motion(result: Mapping[str, Any], before: Mapping[str, JointValues]) -> Iterator[str]:
    """Yield a sentence where efforts vary so differently that the motion or the load is probably another one."""
    pairs = [(joint, before[joint["joint"]]) for joint in result["joints"] if joint["joint"] in before]
    changed = [
        f"{joint['joint']} {joint['spread']:.3g} (before {old['spread']:.3g})"
        for joint, old in pairs
        if joint["spread"]
        and old["spread"]
        and abs(joint["spread"] - old["spread"]) > MAX_SPREAD_CHANGE * old["spread"] + (joint["rms"] or 0.0)
    ]
    if changed:
        yield (
            f"{result['recording']}: another motion or load than in the baseline: the standard deviation of the "
            f"measured effort is {_list_names(changed)}. The RMS of different motions cannot be compared"
        )


def _compare_joint(recording: str, before: JointValues, after: JointValues) -> JointChange:
    increase = _tolerated_increase(before, after)
    return JointChange(
        recording=recording,
        joint=after["joint"],
        verdict_before=_verdict(before),
        verdict=_verdict(after),
        rms_before=before["rms"],
        rms=after["rms"],
        tolerated_increase=increase,
        scale_before=before.get("scale"),
        scale=after.get("scale"),
        reasons=tuple(_reasons(before, after, increase)),
    )


def _verdict(values: JointValues) -> str:
    """The verdict on a joint, also of a file of an earlier version, which has no `verdict`."""
    return str(values.get("verdict", "passed" if values["passed"] else "failed"))


def _tolerated_increase(before: JointValues, after: JointValues) -> float:
    """Increase of the RMS that is tolerated [N m or N]."""
    spread = before["spread"] or 0.0
    amount = max(MAX_RMS_INCREASE * (before["rms"] or 0.0), MIN_RMS_INCREASE * spread)
    if before["samples"] == after["samples"] and abs((after["spread"] or 0.0) - spread) <= SAME_DATA * spread:
        return amount
    return amount + DEVIATIONS * _deviation_of_difference(before, after, "rms_deviation")


def _deviation_of_difference(before: JointValues, after: JointValues, key: str) -> float:
    """Standard deviation of the difference; a value that is missing is taken as large as the present one."""
    known = [values[key] for values in (before, after) if values.get(key) is not None]
    return float(np.sqrt(2 * np.mean(np.square(known)))) if known else 0.0


def _reasons(before: JointValues, after: JointValues, increase: float) -> Iterator[str]:
    if _verdict(before) != "failed" and _verdict(after) == "failed":
        yield f"the verdict was {_verdict(before)}"
    if before["rms"] is not None and after["rms"] is not None and after["rms"] - before["rms"] > increase:
        yield f"RMS {after['rms']:.3g}, before {before['rms']:.3g}, {before['rms'] + increase:.3g} is tolerated"
    scales = before.get("scale"), after.get("scale")
    deviations = before.get("scale_deviation"), after.get("scale_deviation")
    if scales[0] is None or scales[1] is None or None in deviations:
        return
    tolerated = MAX_SCALE_INCREASE + DEVIATIONS * _deviation_of_difference(before, after, "scale_deviation")
    if abs(scales[1] - 1) - abs(scales[0] - 1) > tolerated:
        yield f"scale {scales[1]:.3g}, before {scales[0]:.3g}"
