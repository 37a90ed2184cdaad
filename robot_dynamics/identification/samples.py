"""Samples of several recordings that are fitted together.

Each recording is summed by itself, in this process or in others. Processes return sums, not samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.excerpt import Excerpt, ExcerptSettings
from robot_dynamics.identification.identification_model import EffortModel
from robot_dynamics.identification.sample_sums import NO_SAMPLES, FactorSums, QualitySums

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.sample_sums import FitQuality
    from robot_dynamics.recordings.recording import Recording

CACHE_BYTES = 256 * 1024 * 1024  # memory for regression rows; beyond it they are computed again

ModelT_co = TypeVar("ModelT_co", bound=EffortModel, covariant=True)
SumT = TypeVar("SumT", FactorSums, QualitySums)


ProgressWrapper: TypeAlias = Callable[[Iterable[Any]], Iterable[Any]]
"""Passes the items of an iterable on, one per recording, and shows the progress."""


class Samples(Generic[ModelT_co]):
    """Samples of recordings that are fitted together.

    cutoff, band, start_fraction, end_fraction: as in ExcerptSettings; executor: processes that read the recordings,
    None: this process; progress: wraps the iterator over the recordings, to show progress.
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
        cache_bytes = CACHE_BYTES // max(1, len(recordings))
        self._excerpts = [Excerpt(recording, model, settings, cache_bytes) for recording in recordings]
        self._notes: dict[str, tuple[str, ...]] = {excerpt.recording.name: () for excerpt in self._excerpts}

    @property
    def notes(self) -> list[str]:
        """Sentences on samples that were left out, complete after the first sum."""
        return [f"{name}: {sentence}" for name, sentences in self._notes.items() for sentence in sentences]

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
        run = map if self._executor is None else self._executor.map
        results: Iterable[tuple[SumT, tuple[str, ...]]] = run(partial(_run_task, task), self._excerpts)
        if self._progress is not None:
            results = self._progress(results)
        total: SumT | None = None
        for excerpt, (excerpt_sum, notes) in zip(self._excerpts, results, strict=True):
            total = excerpt_sum if total is None else total + excerpt_sum
            self._notes[excerpt.recording.name] = notes
        if total is None:
            raise RecordingError(NO_SAMPLES)
        return total


def _run_task(task: Callable[[Excerpt], SumT], excerpt: Excerpt) -> tuple[SumT, tuple[str, ...]]:
    """Run a task on an excerpt, and return its notes with the result, since it may run in another process."""
    result = task(excerpt)
    return result, tuple(excerpt.notes)
