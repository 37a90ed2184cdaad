"""Samples of several recordings that are fitted together.

Each recording, and each part of a long one, is summed by itself, in this process or in others. Processes return sums,
not samples.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.excerpt import Excerpt, ExcerptSettings
from robot_dynamics.identification.identification_model import EffortModel
from robot_dynamics.identification.sample_sums import NO_SAMPLES, FactorSums, QualitySums
from robot_dynamics.recordings.recording_division import divide_recording
from robot_dynamics.recordings.recording_parts import IndivisibleRecordingError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.sample_sums import FitQuality
    from robot_dynamics.recordings.recording import Recording
    from robot_dynamics.recordings.sample_statistics import SampleStatistics

CACHE_BYTES = 256 * 1024 * 1024  # memory for regression rows; beyond it they are computed again

ModelT_co = TypeVar("ModelT_co", bound=EffortModel, covariant=True)
SumT = TypeVar("SumT", FactorSums, QualitySums)


ProgressWrapper: TypeAlias = Callable[[Iterable[Any], int], Iterable[Any]]
"""Passes the items of an iterable on, one per recording or part of one, of a number of them, and shows the progress."""


class Samples(Generic[ModelT_co]):
    """Samples of recordings that are fitted together.

    cutoff, band, start_fraction, end_fraction: as in ExcerptSettings; executor: processes that read the recordings,
    None: this process; progress: wraps the iterator over the recordings and parts, to show progress.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        model: ModelT_co,
        *,
        cutoff: float | None = None,
        band: float | None = None,
        start_fraction: float = 0.0,
        end_fraction: float = 1.0,
        executor: Executor | None = None,
        progress: ProgressWrapper | None = None,
    ) -> None:
        self.model: ModelT_co = model
        self._executor = executor
        self._progress = progress
        settings = ExcerptSettings(cutoff, band, start_fraction, end_fraction)
        parts = [part for each in recordings for part in divide_recording(each, cutoff=cutoff, band=band)]
        cache_bytes = CACHE_BYTES // max(1, len(parts))
        self._excerpts = [Excerpt(part, model, settings, cache_bytes) for part in parts]
        self._notes: dict[str, tuple[str, ...]] = {recording.name: () for recording in recordings}

    @property
    def notes(self) -> dict[str, tuple[str, ...]]:
        """Sentences on samples that were left out, by the name of the recording; complete after the first sum."""
        return dict(self._notes)

    def accumulate_factors(self, values: Array | None = None, standard_deviations: Array | None = None) -> FactorSums:
        """Sum the triangular factors of all recordings.

        With values (P,) and standard deviations (n,) of the residuals, rows have Huber weights.
        """
        task = partial(Excerpt.accumulate_factors, values=values, standard_deviations=standard_deviations)
        return self._sum(task)

    def quality(self, values: Array) -> FitQuality:
        """Compute the quality of values (P,) on these samples. Raises RecordingError if there are none."""
        return self.qualities([values])[0]

    def qualities(self, values: Sequence[Array]) -> tuple[FitQuality, ...]:
        """Compute the quality of several sets of values (P,), in one pass. Raises RecordingError if there are none."""
        return self._sum(partial(Excerpt.quality_sums, values=np.array(values))).qualities

    def _sum(self, task: Callable[[Excerpt], SumT]) -> SumT:
        """Sum the results of a task over the excerpts, always in their order, so that rounding is reproducible."""
        try:
            return self._sum_excerpts(task)
        except _IndivisibleRecordingsError as error:
            self._join_parts(error.names)
        return self._sum_excerpts(task)

    def _sum_excerpts(self, task: Callable[[Excerpt], SumT]) -> SumT:
        """Sum over the excerpts. Raises _IndivisibleRecordingsError after all recordings in parts were read."""
        run = map if self._executor is None else self._executor.map
        results: Iterable[TaskResult[SumT] | None] = run(partial(_run_task, task), self._excerpts)
        if self._progress is not None:
            results = self._progress(results, len(self._excerpts))
        total: SumT | None = None
        notes: dict[str, dict[str, None]] = {}
        statistics: dict[str, SampleStatistics] = {}
        indivisible: set[str] = set()
        for number, (excerpt, result) in enumerate(zip(self._excerpts, results, strict=True), 1):
            name = excerpt.recording.name
            if result is None:
                indivisible.add(name)
            if result is None or indivisible:
                if self._names_of_parts(number) <= indivisible:
                    raise _IndivisibleRecordingsError(indivisible)
                continue
            total = result.sums if total is None else total + result.sums
            notes.setdefault(name, {}).update(dict.fromkeys(result.notes))
            if name in statistics:
                statistics[name].append(result.statistics)
            else:
                statistics[name] = result.statistics
        if total is None:
            raise RecordingError(NO_SAMPLES)
        self._store_notes(notes, statistics)
        return total

    def _store_notes(self, notes: dict[str, dict[str, None]], statistics: dict[str, SampleStatistics]) -> None:
        for name, counts in statistics.items():
            self._notes[name] = (*notes[name], *counts.sentences)

    def _names_of_parts(self, number: int) -> set[str]:
        """Names of the recordings that have parts among the excerpts from a number on."""
        return {each.recording.name for each in self._excerpts[number:] if each.recording.part is not None}

    def _join_parts(self, names: set[str]) -> None:
        """Replace the parts of recordings by the whole recordings."""
        counts = Counter(each.recording.name for each in self._excerpts)
        excerpts = []
        for each in self._excerpts:
            recording = each.recording
            if recording.part is None or recording.name not in names:
                excerpts.append(each)
            elif recording.part.begin is None:  # the first part
                cache_bytes = each.cache_bytes * counts[recording.name]
                excerpts.append(Excerpt(replace(recording, part=None), self.model, each.settings, cache_bytes))
        self._excerpts = excerpts


class _IndivisibleRecordingsError(Exception):
    """Recordings, by their names, whose parts depend on each other."""

    def __init__(self, names: set[str]) -> None:
        super().__init__(names)
        self.names = names


@dataclass(frozen=True, eq=False)
class TaskResult(Generic[SumT]):
    """Sums over an excerpt, sentences on damage of its files, and counts of samples that were left out."""

    sums: SumT
    notes: tuple[str, ...]
    statistics: SampleStatistics


def _run_task(task: Callable[[Excerpt], SumT], excerpt: Excerpt) -> TaskResult[SumT] | None:
    """Run a task on an excerpt, and return its notes with the result, since it may run in another process.

    None of a part that depends on other parts.
    """
    try:
        sums = task(excerpt)
    except IndivisibleRecordingError:
        return None
    return TaskResult(sums, excerpt.notes, deepcopy(excerpt.statistics))
