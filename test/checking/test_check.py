"""Checks of recordings with known truth: efforts by Pinocchio, with noise, friction and faults added."""

import numpy as np
import pytest
from peers.recorded import JOINTS, message, messages, panda_motion, uneven_times, write_bag

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking.check import CheckSums, check, judge
from robot_dynamics.checking.comparison import Comparison
from robot_dynamics.checking.prediction_filter import PredictedMotion
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.errors import DescriptionError, RecordingError
from robot_dynamics.recordings.drives import direct_drives, load_drives, write_drives
from robot_dynamics.recordings.joint_motions import Motion
from robot_dynamics.recordings.recording import open_recording
from robot_dynamics.recordings.sample_statistics import SampleStatistics

DYNAMICS = Dynamics(load_robot("panda"))
MOTION = panda_motion(duration=20.0)
NOISE = 0.3


def noisy(motion=MOTION, seed=0):
    rng = np.random.default_rng(seed)
    return motion._replace(efforts=motion.efforts + NOISE * rng.normal(size=motion.efforts.shape))


def checked(path, drives=None, tolerances=None, **settings):
    drives = drives or direct_drives(JOINTS)
    return check(open_recording(path, drives), DYNAMICS, tolerances or load_tolerances(), **settings)


def failed(result):
    return [verdict.joint.joint for verdict in result.verdicts if verdict.failed]


def test_check_of_efforts_by_pinocchio_passes_with_the_noise_as_residual(tmp_path):
    result = checked(write_bag(tmp_path / "run", messages(noisy())))
    assert result.passed and result.segments == () and result.first_failure_time is None
    for verdict in result.verdicts:
        # the noise up to 8 of 50 Hz is left, and the part of the motion that the filter removes
        assert verdict.joint.rms == pytest.approx(NOISE * np.sqrt(8 / 50), rel=0.1)
        assert verdict.joint.rms_unfiltered == pytest.approx(NOISE, rel=0.05)
        assert abs(verdict.joint.bias) < 0.03
        assert verdict.joint.samples == len(MOTION.times) - 26  # 13 at either end, a period of 8 Hz
    edges, scale = result.notes
    assert (
        edges == "26 samples are at the ends of segments, where the filter has data on one side only, and were skipped"
    )
    assert scale.startswith(
        "scale too uncertain for a verdict, by its deviation or a small effort: panda_joint5 0.931 ± 0.092. Record"
    )


def test_comparison_agrees_with_statistics_by_numpy():
    rng, motion_count = np.random.default_rng(0), 3
    comparison, parts = Comparison(("a", "b")), []
    for part in range(motion_count):
        m, p = rng.normal(size=(2, 700, 2)) * [1, 30] + [5, 100]
        zero = np.zeros((700, 2))
        measured, moving = np.ones(2, dtype=bool), np.ones(zero.shape, dtype=bool)
        motion = Motion(7.0 * part, 100.0, 8.0, zero, zero, zero, m, m + 1, measured, moving)
        comparison.add(PredictedMotion(motion, p - 1, p, zero))
        parts.append((m, p))
    m, p = (np.concatenate(values) for values in zip(*parts, strict=True))
    r = m - p
    for column, joint in enumerate(comparison.joint_comparisons):
        slope, _ = np.polyfit(p[:, column], m[:, column], 1)
        expected = {
            "rms": np.sqrt((r[:, column] ** 2).mean()),
            "bias": r[:, column].mean(),
            "spread": m[:, column].std(),
            "largest": np.abs(r[:, column]).max(),
            "correlation": np.corrcoef(m[:, column], p[:, column])[0, 1],
            "scale": slope,
            "at": np.abs(r[:, column]).argmax() / 100,
            "rms_unfiltered": np.sqrt(((r[:, column] + 2) ** 2).mean()),
            "effort_rms": np.sqrt((m[:, column] ** 2).mean()),
            "noise": np.sqrt(8 / 42),  # unfiltered less filtered is 1 between 8 and 50 Hz
            "resting": 0.0,
        }
        for key, value in expected.items():
            assert getattr(joint, key) == pytest.approx(value, rel=1e-9), key
    starts, rms = comparison.window_rms
    assert np.array_equal(starts, np.arange(21))
    assert np.allclose(rms, np.sqrt((r.reshape(21, 100, 2) ** 2).mean(axis=1)))


def test_check_reports_the_joint_and_the_time_of_a_failure(tmp_path):
    motion = noisy()
    motion.efforts[1230:1500, 5] += 6.0
    result = checked(write_bag(tmp_path / "run", messages(motion)))
    assert failed(result) == ["panda_joint6"]
    (segment,) = result.segments
    assert segment.joint == "panda_joint6" and segment.start == pytest.approx(12.3, abs=1.0)
    assert segment.end == pytest.approx(15.0, abs=1.0) and segment.rms > 4
    assert result.as_dict()["since"] == segment.start


def test_check_reports_a_wrong_sign_a_wrong_unit_and_a_bias(tmp_path):
    motion = noisy()
    motion.efforts[:, 1] *= -1
    motion.efforts[:, 3] *= 0.1
    motion.efforts[:, 4] += 3.0
    result = checked(write_bag(tmp_path / "run", messages(motion)))
    assert failed(result) == ["panda_joint2", "panda_joint4", "panda_joint5"]
    sentences = {verdict.joint.joint: "; ".join(verdict.failures) for verdict in result.verdicts}
    assert "opposite signs" in sentences["panda_joint2"]
    assert "0.1 times the prediction" in sentences["panda_joint4"]
    assert "a bias of 3" in sentences["panda_joint5"]


def test_drives_describe_motors_gains_offsets_and_gravity(tmp_path):
    """The same motion, measured at motors of which two turn with two joints, as currents, without gravity."""
    rng = np.random.default_rng(4)
    R = np.diag([100, -100, 50, 50, 80, 80, 40.0])
    R[6, 5] = 40
    kt = rng.uniform(0.05, 0.2, 7)
    offsets, friction = rng.uniform(-1, 1, 7), rng.uniform(0.1, 0.3, 3)
    motors = [f"motor_{k}" for k in range(7)]
    at_motors = (MOTION.q - [0, 0.5, 0, 0, 0, 0, 0]) @ R.T
    # efforts between joints 6 and 7 through motor 6, and the Coulomb friction of both together
    coupling_efforts = np.zeros_like(MOTION.q)
    for a, b in ((5, 6), (6, 5)):
        coupling_efforts[:, a] = friction[0] * MOTION.qdd[:, b] + friction[1] * MOTION.qd[:, b]
        coupling_efforts[:, a] += friction[2] * np.sign(MOTION.qd[:, 5] + MOTION.qd[:, 6])
    gravity = DYNAMICS.gravity(MOTION.q)
    currents = (MOTION.efforts - gravity + offsets + coupling_efforts) @ np.linalg.inv(R) / kt
    states = [
        message(t, motors, q, (), current) for t, q, current in zip(MOTION.times, at_motors, currents, strict=True)
    ]
    ratios = "".join(
        f"  {motor}: {{{', '.join(f'{JOINTS[k]}: {row[k]}' for k in np.flatnonzero(row))}}}\n"
        for motor, row in zip(motors, R, strict=True)
    )
    text = (
        f"format: 1\nmotors:\n{ratios}position_offsets: {{panda_joint2: 0.5}}\neffort_excludes_gravity: true\n"
        f"effort_gains: {{{', '.join(f'{m}: {g}' for m, g in zip(motors, kt, strict=True))}}}\n"
        f"effort_offsets: {{{', '.join(f'{j}: {o}' for j, o in zip(JOINTS, offsets, strict=True))}}}\n"
        f"coupled: {{motor_6: {{rotor_inertia: {friction[0]}, viscous_friction: {friction[1]}, "
        f"coulomb_friction: {friction[2]}}}}}\n"
    )
    (tmp_path / "drives.yaml").write_text(text)
    drives = load_drives(tmp_path / "drives.yaml", JOINTS)
    bag = write_bag(tmp_path / "run", states)
    result = checked(bag, drives, cutoff=20.0)
    assert max(verdict.joint.rms for verdict in result.verdicts) < 0.08  # the filter smooths friction at reversals
    (tmp_path / "again.yaml").write_text(write_drives(drives))
    again = checked(bag, load_drives(tmp_path / "again.yaml", JOINTS), cutoff=20.0)
    rms = ([verdict.joint.rms for verdict in each.verdicts] for each in (again, result))
    assert next(rms) == pytest.approx(next(rms), rel=1e-9)
    direct = load_drives(None, JOINTS)
    with pytest.raises(RecordingError, match="joints missing: panda_joint1"):
        checked(bag, direct)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("motors: {}", "format missing"),
        ("format: 1\ngains: {}", "unknown key 'gains'"),
        ("format: 1\neffort_offsets: {panda_joint9: 1}", "unknown joint 'panda_joint9'"),
        ("format: 1\nmotors: {a: {panda_joint1: 1}}", "1 motors drive 7 joints"),
        ("format: 1\ncoupled: {m: {viscous_friction: 1}}", "unknown motor of several joints 'm'"),
        ("format: 1\neffort_gains: {panda_joint1: 1/0}", "line 2"),
    ],
)
def test_load_drives_refuses_invalid_files(tmp_path, text, message):
    (tmp_path / "drives.yaml").write_text(text)
    with pytest.raises(DescriptionError, match=message):
        load_drives(tmp_path / "drives.yaml", JOINTS)


def test_load_tolerances_overrides_the_default(tmp_path):
    (tmp_path / "tight.yaml").write_text(
        "format: 1\njoints: {panda_joint7: {effort_share: 0.001, normalised_rms: 0.01, noise_factor: 0.5}}"
    )
    bag = write_bag(tmp_path / "run", messages(noisy()))
    assert failed(checked(bag, tolerances=load_tolerances(tmp_path / "tight.yaml", JOINTS))) == ["panda_joint7"]
    (tmp_path / "wrong.yaml").write_text("format: 1\njoints: {joint7: {effort_share: 0.1}}")
    with pytest.raises(DescriptionError, match="panda_joint7"):
        load_tolerances(tmp_path / "wrong.yaml", JOINTS)
    (tmp_path / "wrong.yaml").write_text("format: 1\nnormalised_rms: -1")
    with pytest.raises(DescriptionError, match="line 2"):
        load_tolerances(tmp_path / "wrong.yaml")


@pytest.mark.slow
def test_check_refuses_constant_efforts_and_names_joints_without_efforts(tmp_path):
    silent = MOTION._replace(efforts=0 * MOTION.efforts)
    with pytest.raises(RecordingError, match="efforts are constant throughout"):
        checked(write_bag(tmp_path / "silent", messages(silent)))
    motion = noisy()
    motion.efforts[:, 2] = 0
    result = checked(write_bag(tmp_path / "one", messages(motion)))
    assert failed(result) == ["panda_joint3"]
    motion.efforts[:, 2] = np.nan
    result = checked(write_bag(tmp_path / "nan", messages(motion)))
    assert failed(result) == ["panda_joint3"]
    assert "efforts that were not measured: panda_joint3" in result.notes
    nothing = [message(t, JOINTS, q) for t, q in zip(MOTION.times, MOTION.q, strict=True)]
    with pytest.raises(RecordingError, match="nothing was measured"):
        checked(write_bag(tmp_path / "none", nothing))
    with pytest.raises(RecordingError, match=r"no samples are left\. .*samples are in segments too short"):
        checked(write_bag(tmp_path / "short", messages(MOTION)[:9]))


def test_check_reads_csv_with_named_columns(tmp_path):
    head = ["time", *(f"{name}.{field}" for field in ("effort", "position") for name in JOINTS), "note"]
    rows = [[t + 1.5, *tau, *q] for t, tau, q in zip(MOTION.times, MOTION.efforts, MOTION.q, strict=True)]
    lines = [",".join(head), *(",".join(f"{x:.12g}" for x in row) + ",0" for row in rows)]
    lines[500] = lines[500].replace(",", ",oops,", 1)
    (tmp_path / "run.csv").write_text("\n".join(lines))
    result = checked(tmp_path / "run.csv")
    assert result.passed and max(verdict.joint.rms for verdict in result.verdicts) < 0.1
    assert any("cells have no number and were taken as missing: " in note for note in result.notes)
    (tmp_path / "bare.csv").write_text("\n".join(lines[1:]))
    with pytest.raises(RecordingError, match="first line has no column names"):
        checked(tmp_path / "bare.csv")
    (tmp_path / "other.csv").write_text("time,a,b\n0,1,2\n")
    with pytest.raises(RecordingError, match=r"has no column <joint>\.position: .*; it has "):
        checked(tmp_path / "other.csv")


def table_lines(motion, times=None, head=None):
    """The lines of a CSV of a motion: times [s], positions and efforts."""
    head = head or ["time", *(f"{name}.{field}" for field in ("position", "effort") for name in JOINTS)]
    rows = np.column_stack([motion.times if times is None else times, motion.q, motion.efforts])[:, : len(head)]
    return [",".join(head), *(",".join(f"{x:.12g}" for x in row) for row in rows)]


def test_table_skips_and_counts_broken_lines_without_clock_jumps(tmp_path):
    lines = table_lines(MOTION)
    whole, broken = tmp_path / "whole.csv", tmp_path / "broken.csv"
    whole.write_text("\n".join(lines))
    lines[700:700] = ["", "hello,world", lines[700].replace(lines[700].split(",")[0], "x", 1), "inf," + lines[700]]
    lines[300:300] = [""]
    broken.write_text("\n".join(lines) + "\n\n")
    expected, result = checked(whole), checked(broken)
    assert "6 rows have a time that is no finite number, or beyond 9e+09 s, and were skipped" in result.notes
    assert not any("clock" in note or "gaps" in note for note in result.notes)
    assert (result.duration, result.comparison.samples) == (expected.duration, expected.comparison.samples)
    rms = [[verdict.joint.rms for verdict in each.verdicts] for each in (result, expected)]
    assert rms[0] == pytest.approx(rms[1], rel=1e-12)


def test_table_rows_with_more_cells_than_names_do_not_shift_the_next_rows(tmp_path):
    lines = table_lines(MOTION)
    (tmp_path / "twice.csv").write_text("\n".join([lines[0], *(f"{line},{line}" for line in lines[1:])]))
    assert not any("stamp of the previous message" in note for note in checked(tmp_path / "twice.csv").notes)


@pytest.mark.parametrize("kind", ["random", "pairs", "pieces"])
@pytest.mark.parametrize("as_bag", [True, False], ids=["bag", "csv"])
def test_check_of_uneven_stamps_and_pieces_between_gaps_notes_skipped_samples(tmp_path, kind, as_bag):
    motion = noisy(panda_motion(times=uneven_times(kind, 20.0)))
    if as_bag:
        path = write_bag(tmp_path / "run", messages(motion))
    else:
        path = tmp_path / "run.csv"
        path.write_text("\n".join(table_lines(motion)))
    result = checked(path)
    assert result.passed and result.segments == ()
    assert min(verdict.joint.samples for verdict in result.verdicts) > 500
    notes = "; ".join(result.notes)
    assert ("too short to be filtered" in notes) or kind != "pieces"
    assert ("less than a third of the usual step" in notes) or kind == "pieces"


def test_check_refuses_a_recording_of_short_pieces_with_the_reason(tmp_path):
    """Pieces of 3 and 12 samples, with pauses of 0.3 s: there are efforts, but no piece can be filtered."""
    times = np.cumsum(np.tile([0.3, 0.009, 0.011, 0.3] + 11 * [0.01], 40))
    path = write_bag(tmp_path / "run", messages(noisy(panda_motion(times=times))))
    with pytest.raises(RecordingError, match=r"are left\. 79 gaps.*600 samples are in segments too short"):
        checked(path)


def test_check_refuses_an_incomplete_csv_with_the_reason(tmp_path):
    path, lines = tmp_path / "run.csv", table_lines(MOTION)
    effortless = table_lines(MOTION, head=["time", *(f"{name}.position" for name in JOINTS)])
    for csv_lines, expected in (
        (effortless, "no efforts are recorded: nothing was measured; columns panda_joint1.effort, panda_joint2.effort"),
        (lines[:1], r"run.csv: no samples are left\. It has no row"),
        ([lines[0], "x", "y"], "no samples are left.*2 rows have a time that is no finite number"),
        (
            [lines[0], *lines[:90:-1]],
            "1 samples of the joints: at least 8 are needed; .* older than the previous",
        ),
    ):
        path.write_text("\n".join(csv_lines))
        with pytest.raises(RecordingError, match=expected):
            checked(path)


def test_check_notes_probable_degrees_and_milliseconds(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("\n".join(table_lines(MOTION)))
    notes = checked(path).notes
    assert not any("?" in note for note in notes)
    path.write_text("\n".join(table_lines(MOTION._replace(q=np.degrees(MOTION.q)))))
    assert any(
        "beyond the limits of the model (are these degrees?): panda_joint" in note for note in checked(path).notes
    )
    path.write_text("\n".join(table_lines(MOTION, times=1000 * MOTION.times)))
    assert (
        "rows are 10 s apart: are the times in milliseconds or nanoseconds? Seconds are needed" in checked(path).notes
    )


def test_check_names_columns_with_empty_cells_and_other_separators(tmp_path):
    path, lines = tmp_path / "run.csv", table_lines(MOTION)
    head = lines[0].split(",")
    column = head.index("panda_joint3.effort")

    def emptied(line):
        cells = line.split(",")
        return ",".join([*cells[:column], "", *cells[column + 1 :]])

    path.write_text("\n".join([*lines[:500], *map(emptied, lines[500:600]), *lines[600:]]))
    result = checked(path)
    note = "cells are empty and were taken as missing: panda_joint3.effort (100 rows)"
    assert note in result.notes and "1 gaps; no samples are interpolated across a gap" in "; ".join(result.notes)
    assert not any(str(path) in note for note in result.notes)
    efforts = [number for number, name in enumerate(head) if name.endswith(".effort")]
    rows = [line.split(",") for line in lines[1:]]
    empty = [",".join("" if number in efforts else cell for number, cell in enumerate(row)) for row in rows]
    path.write_text("\n".join([lines[0], *empty]))
    with pytest.raises(RecordingError, match=r"nothing was measured; cells are empty .*: panda_joint1.effort \(2000 r"):
        checked(path)
    path.write_text("\n".join([lines[0].replace("panda_joint3.effort", "panda_joint3.eff"), *lines[1:]]))
    with pytest.raises(RecordingError, match=r"no efforts are read, because columns are missing: panda_joint3.effort$"):
        checked(path)
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        path.write_text("\n".join(lines).replace(",", separator))
        with pytest.raises(RecordingError, match=f"columns are separated by {name}. Separate them by commas"):
            checked(path)


@pytest.mark.parametrize(
    ("notes", "reason"), [((), "It has no motion"), (("the file breaks off",), "the file breaks off")]
)
def test_parts_without_samples_are_refused_with_the_notes_of_the_files(notes, reason):
    total = CheckSums(Comparison(DYNAMICS.joint_names), SampleStatistics())
    total.append(CheckSums(Comparison(DYNAMICS.joint_names), SampleStatistics(), notes))
    with pytest.raises(RecordingError, match=rf"run: no samples are left\. {reason}$"):
        judge("run", DYNAMICS, load_tolerances(), total)
