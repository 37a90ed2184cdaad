"""Long recordings in parts: with every executor the same figures, which are those of the whole recording."""

import os
import pickle
import shutil
from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
import pytest
from peers.cluster import cluster_executor
from peers.recorded import JOINTS, messages, panda_motion, write_bag

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking import batch_check
from robot_dynamics.checking.batch_check import CheckOptions, check_recordings
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.samples import Samples
from robot_dynamics.recordings import recording_division
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import Recording, open_recording
from robot_dynamics.recordings.recording_parts import IndivisibleRecordingError

pytestmark = pytest.mark.timeout(240)
DYNAMICS = Dynamics(load_robot("panda"))
DRIVES = direct_drives(JOINTS)
PART_MESSAGES = 13_000
OPTIONS = CheckOptions(DYNAMICS, DRIVES, (), load_tolerances(None))


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """260 s at 100 Hz, with noise, and a push against joint 4 from 200 s on."""
    motion = panda_motion(260.0)
    efforts = motion.efforts + 0.05 * np.random.default_rng(2).normal(size=motion.efforts.shape)
    efforts[20_000:, 3] += 12.0
    return write_bag(tmp_path_factory.mktemp("bag") / "long", messages(motion._replace(efforts=efforts)))


@pytest.fixture(scope="module")
def executor():
    with cluster_executor() as opened:
        yield opened


def check(path, options, executor=None):
    (outcome,) = check_recordings([path], options, executor)
    assert outcome.error is None, outcome.error
    return outcome


def test_check_of_parts_is_that_of_the_whole(path):
    whole = check(path, OPTIONS).check
    parts = check(path, replace(OPTIONS, part_messages=PART_MESSAGES)).check
    assert parts.comparison.samples == whole.comparison.samples
    assert [segment.joint for segment in parts.segments] == [segment.joint for segment in whole.segments]
    assert parts.first_failure_time == whole.first_failure_time == 200.0
    assert (parts.duration, parts.coverage) == pytest.approx((whole.duration, whole.coverage))
    assert parts.notes == whole.notes
    for ours, theirs in zip(parts.verdicts, whole.verdicts, strict=True):
        assert (ours.word, ours.joint.samples) == (theirs.word, theirs.joint.samples)
        for field in ("rms", "rms_deviation", "rms_unfiltered", "scale", "scale_deviation", "correlation", "spread"):
            # transients of filters where pieces end
            assert getattr(ours.joint, field) == pytest.approx(getattr(theirs.joint, field), rel=1e-4), field


@pytest.mark.skipif("EVERY_PART" not in os.environ, reason="takes long: a part of `make soak`")
def test_check_with_a_cluster_is_that_of_one_process(path, executor):
    options = replace(OPTIONS, part_messages=PART_MESSAGES, faults=True)
    local, remote = check(path, options), check(path, options, executor)
    assert remote.as_dict() == {**local.as_dict(), "recording": str(path)}
    assert remote.fault is not None and remote.fault.sentence == local.fault.sentence
    assert (local.fault.joints, round(local.fault.onset)) == (("panda_joint4",), 200)
    np.testing.assert_array_equal(
        remote.check.comparison.plot_samples.measured, local.check.comparison.plot_samples.measured
    )


def test_progress_counts_each_message_of_all_parts_once(path):
    bars = []

    def progress(items):
        bars.append(0)
        try:
            for item in items:
                bars[-1] += 1
                yield item
        finally:
            bars.append("closed")

    recording = open_recording(path, DRIVES)
    batch_check.check_recording(recording, replace(OPTIONS, part_messages=PART_MESSAGES), progress=progress)
    assert bars == [recording.message_count, "closed"]


def test_progress_of_samples_has_the_number_of_parts(path, monkeypatch):
    monkeypatch.setattr(recording_division, "PART_MESSAGES", PART_MESSAGES)
    totals = []
    sums(path, progress=lambda items, total: totals.append(total) or items)
    assert totals == [2, 2]


class PicklingExecutor(Executor):
    """Runs tasks at once, and passes tasks and results on as another process does."""

    def __init__(self, after_first_task):
        self.after_first_task = after_first_task

    def submit(self, function, /, *arguments):
        task, inputs = pickle.loads(pickle.dumps((function, arguments)))
        future = LateResult()
        try:
            future.content = pickle.dumps(task(*inputs))
            future.set_result(None)
        except RobotDynamicsError as error:
            future.set_exception(error)
        self.after_first_task()
        self.after_first_task = lambda: None
        return future


class LateResult(Future):
    def result(self, timeout=None):
        super().result(timeout)
        return pickle.loads(self.content)


def test_recording_that_another_process_can_no_longer_open_does_not_end_the_batch(path, tmp_path):
    missing_path = tmp_path / "missing"
    shutil.copytree(path, missing_path)
    executor = PicklingExecutor(lambda: shutil.rmtree(missing_path))
    options = replace(OPTIONS, part_messages=PART_MESSAGES)
    first, second = check_recordings([missing_path, path], options, executor)
    assert first.error == f"{missing_path} does not exist"
    assert second.check.as_dict() == check(path, options).check.as_dict()


def sums(path, executor=None, **options):
    model = build_identification_model(DYNAMICS, DRIVES)
    samples = Samples([open_recording(path, DRIVES)], model, executor=executor, **options)
    values = np.ones(len(model.names))
    factors = samples.accumulate_factors()
    return factors, samples.quality(values), samples.notes


@pytest.mark.skipif("EVERY_PART" not in os.environ, reason="takes long: a part of `make soak`")
def test_sums_for_identification_are_those_of_one_process_and_of_the_whole(path, executor, monkeypatch):
    options = {"end_fraction": 0.8}
    whole, whole_quality, whole_notes = sums(path, **options)
    monkeypatch.setattr(recording_division, "PART_MESSAGES", PART_MESSAGES)
    local, quality, notes = sums(path, **options)
    remote, remote_quality, remote_notes = sums(path, executor, **options)
    np.testing.assert_array_equal(remote.factors.triangles, local.factors.triangles)
    np.testing.assert_array_equal(remote_quality.rms, quality.rms)
    assert notes == remote_notes == whole_notes and quality.samples == whole_quality.samples
    # the rows are decimated from other samples on
    np.testing.assert_allclose(quality.rms, whole_quality.rms, rtol=1e-3)
    np.testing.assert_allclose(quality.rms_unfiltered, whole_quality.rms_unfiltered, rtol=1e-5)
    np.testing.assert_allclose(local.effective_samples, whole.effective_samples, rtol=1e-3)


@pytest.mark.skipif("EVERY_PART" not in os.environ, reason="takes long: a part of `make soak`")
def test_recording_whose_parts_depend_on_each_other_is_read_as_a_whole(path, monkeypatch):
    whole = check(path, OPTIONS).check

    def refuse(self, *arguments):
        if self.part.begin is not None:
            raise IndivisibleRecordingError("the clock jumps")
        yield from ()

    monkeypatch.setattr(Recording, "_part_motions", refuse)
    monkeypatch.setattr(recording_division, "PART_MESSAGES", PART_MESSAGES)
    assert len(batch_check._divide(open_recording(path, DRIVES), OPTIONS)) == 2
    assert check(path, OPTIONS).check.as_dict() == whole.as_dict()
    _, quality, notes = sums(path)
    assert quality.samples == whole.comparison.samples and len(notes) == len(whole.notes)


@pytest.mark.skipif("EVERY_PART" not in os.environ, reason="takes long: a part of `make soak`")
def test_only_recordings_whose_parts_depend_on_each_other_are_read_as_a_whole(path, tmp_path, monkeypatch):
    jumping = [tmp_path / "first", tmp_path / "second"]
    for copy in jumping:
        copy.symlink_to(path)
    read_part = Recording._part_motions

    def refuse(self, part, *arguments):
        if self.source.path in jumping and part.begin is not None:
            raise IndivisibleRecordingError("the clock jumps")
        yield from read_part(self, part, *arguments)

    monkeypatch.setattr(Recording, "_part_motions", refuse)
    monkeypatch.setattr(recording_division, "PART_MESSAGES", PART_MESSAGES)
    totals = []
    recordings = [open_recording(each, DRIVES) for each in (jumping[0], path, jumping[1])]
    model = build_identification_model(DYNAMICS, DRIVES)
    samples = Samples(recordings, model, progress=lambda items, total: totals.append(total) or items)
    quality = samples.quality(np.ones(len(model.names)))
    assert totals == [6, 4]
    assert quality.samples == 3 * sums(path)[1].samples
