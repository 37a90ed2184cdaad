"""Checks of recordings whose truth is known: efforts by Pinocchio, noise, frictions and faults that were put in."""

import numpy as np
import pytest
from peers.recorded import JOINTS, message, messages, panda_motion, uneven_times, write_bag

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking.check import check
from robot_dynamics.checking.comparison import Comparison
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.errors import DescriptionError, RecordingError
from robot_dynamics.recordings.drives import direct_drives, load_drives, write_drives
from robot_dynamics.recordings.joint_motions import Motion
from robot_dynamics.recordings.recording import open_recording

DYNAMICS = Dynamics(load_robot("panda"))
MOTION = panda_motion(duration=20.0)
NOISE = 0.3


def noisy(motion=MOTION, seed=0):
    rng = np.random.default_rng(seed)
    return motion._replace(efforts=motion.efforts + NOISE * rng.normal(size=motion.efforts.shape))


def checked(path, drives=None, tolerances=None, **settings):
    drives = drives or direct_drives(JOINTS)
    return check(open_recording(path, drives), DYNAMICS, tolerances or load_tolerances(), **settings)


def failed(found):
    return [verdict.joint.joint for verdict in found.verdicts if not verdict.passed]


def test_what_pinocchio_computed_passes_with_the_noise_as_residual(tmp_path):
    found = checked(write_bag(tmp_path / "run", messages(noisy())))
    assert found.passed and found.segments == () and found.first_failure_time is None
    for verdict in found.verdicts:
        # noise of the band up to 8 of 50 Hz is left, and, of the motion, what the filter takes off
        assert verdict.joint.rms == pytest.approx(NOISE * np.sqrt(8 / 50), rel=0.1)
        assert verdict.joint.rms_unfiltered == pytest.approx(NOISE, rel=0.05)
        assert abs(verdict.joint.bias) < 0.03
        assert verdict.joint.samples == len(MOTION.times) - 26  # 13 at either end, a period of 8 Hz
    assert found.notes == (
        "26 samples are at the ends of stretches, where the filter sees one side only, and were left out",
    )


def test_sums_are_those_of_numpy():
    rng, motion_count = np.random.default_rng(0), 3
    comparison, parts = Comparison(("a", "b")), []
    for part in range(motion_count):
        m, p = rng.normal(size=(2, 700, 2)) * [1, 30] + [5, 100]
        zero = np.zeros((700, 2))
        motion = Motion(7.0 * part, 100.0, 8.0, zero, zero, zero, m, m + 1, np.ones(2, dtype=bool))
        comparison.add(motion, p)
        parts.append((m, p))
    m, p = (np.concatenate(values) for values in zip(*parts, strict=True))
    r = m - p
    for column, joint in enumerate(comparison.joint_comparisons):
        slope, _ = np.polyfit(p[:, column], m[:, column], 1)
        expected = {
            "rms": np.sqrt((r[:, column] ** 2).mean()), "bias": r[:, column].mean(), "spread": m[:, column].std(),
            "largest": np.abs(r[:, column]).max(), "correlation": np.corrcoef(m[:, column], p[:, column])[0, 1],
            "scale": slope, "at": np.abs(r[:, column]).argmax() / 100,
            "rms_unfiltered": np.sqrt(((r[:, column] + 1) ** 2).mean()),
        }  # fmt: skip
        for key, value in expected.items():
            assert getattr(joint, key) == pytest.approx(value, rel=1e-9), key
    starts, rms = comparison.window_rms
    assert np.array_equal(starts, np.arange(21))
    assert np.allclose(rms, np.sqrt((r.reshape(21, 100, 2) ** 2).mean(axis=1)))


def test_a_joint_that_goes_wrong_is_named_with_the_time(tmp_path):
    told = noisy()
    told.efforts[1230:1500, 5] += 6.0
    found = checked(write_bag(tmp_path / "run", messages(told)))
    assert failed(found) == ["panda_joint6"]
    (segment,) = found.segments
    assert segment.joint == "panda_joint6" and segment.start == pytest.approx(12.3, abs=1.0)
    assert segment.end == pytest.approx(15.0, abs=1.0) and segment.rms > 4
    assert found.as_dict()["since"] == segment.start


def test_a_wrong_sign_a_wrong_unit_and_a_bias_are_told(tmp_path):
    told = noisy()
    told.efforts[:, 1] *= -1
    told.efforts[:, 3] *= 0.1
    told.efforts[:, 4] += 3.0
    found = checked(write_bag(tmp_path / "run", messages(told)))
    assert failed(found) == ["panda_joint2", "panda_joint4", "panda_joint5"]
    sentences = {verdict.joint.joint: "; ".join(verdict.failures) for verdict in found.verdicts}
    assert "opposite signs" in sentences["panda_joint2"]
    assert "0.1 times the prediction" in sentences["panda_joint4"]
    assert "a bias of 3" in sentences["panda_joint5"]


def test_drives_tell_of_motors_gains_offsets_and_gravity(tmp_path):
    """The same motion, measured at motors of which two turn with two joints, as currents, without gravity."""
    rng = np.random.default_rng(4)
    R = np.diag([100, -100, 50, 50, 80, 80, 40.0])
    R[6, 5] = 40
    kt = rng.uniform(0.05, 0.2, 7)
    offsets, friction = rng.uniform(-1, 1, 7), rng.uniform(0.1, 0.3, 3)
    motors = [f"motor_{k}" for k in range(7)]
    at_motors = (MOTION.q - [0, 0.5, 0, 0, 0, 0, 0]) @ R.T
    # what joints 6 and 7 feel of each other through motor 6, and the Coulomb friction of both together
    felt = np.zeros_like(MOTION.q)
    for a, b in ((5, 6), (6, 5)):
        felt[:, a] = friction[0] * MOTION.qdd[:, b] + friction[1] * MOTION.qd[:, b]
        felt[:, a] += friction[2] * np.sign(MOTION.qd[:, 5] + MOTION.qd[:, 6])
    gravity = DYNAMICS.gravity(MOTION.q)
    currents = (MOTION.efforts - gravity + offsets + felt) @ np.linalg.inv(R) / kt
    told = [message(t, motors, q, (), current)
            for t, q, current in zip(MOTION.times, at_motors, currents, strict=True)]  # fmt: skip
    ratios = "".join(f"  {motor}: {{{', '.join(f'{JOINTS[k]}: {row[k]}' for k in np.flatnonzero(row))}}}\n"
                     for motor, row in zip(motors, R, strict=True))  # fmt: skip
    text = (
        f"format: 1\nmotors:\n{ratios}position_offsets: {{panda_joint2: 0.5}}\neffort_excludes_gravity: true\n"
        f"effort_gains: {{{', '.join(f'{m}: {g}' for m, g in zip(motors, kt, strict=True))}}}\n"
        f"effort_offsets: {{{', '.join(f'{j}: {o}' for j, o in zip(JOINTS, offsets, strict=True))}}}\n"
        f"coupled: {{motor_6: {{rotor_inertia: {friction[0]}, viscous_friction: {friction[1]}, "
        f"coulomb_friction: {friction[2]}}}}}\n"
    )
    (tmp_path / "drives.yaml").write_text(text)
    drives = load_drives(tmp_path / "drives.yaml", JOINTS)
    bag = write_bag(tmp_path / "run", told)
    found = checked(bag, drives, cutoff=20.0)
    assert max(verdict.joint.rms for verdict in found.verdicts) < 0.08  # what the filter does at reversals
    (tmp_path / "again.yaml").write_text(write_drives(drives))
    again = checked(bag, load_drives(tmp_path / "again.yaml", JOINTS), cutoff=20.0)
    rms = ([verdict.joint.rms for verdict in each.verdicts] for each in (again, found))
    assert next(rms) == pytest.approx(next(rms), rel=1e-9)
    left_out = load_drives(None, JOINTS)
    with pytest.raises(RecordingError, match="joints missing: panda_joint1"):
        checked(bag, left_out)


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
def test_wrong_drives_are_refused(tmp_path, text, message):
    (tmp_path / "drives.yaml").write_text(text)
    with pytest.raises(DescriptionError, match=message):
        load_drives(tmp_path / "drives.yaml", JOINTS)


def test_tolerances_come_from_a_file_over_those_that_ship(tmp_path):
    (tmp_path / "tight.yaml").write_text(
        "format: 1\njoints: {panda_joint7: {effort_share: 0.001, normalised_rms: 0.01}}"
    )
    bag = write_bag(tmp_path / "run", messages(noisy()))
    assert failed(checked(bag, tolerances=load_tolerances(tmp_path / "tight.yaml", JOINTS))) == ["panda_joint7"]
    (tmp_path / "wrong.yaml").write_text("format: 1\njoints: {joint7: {effort_share: 0.1}}")
    with pytest.raises(DescriptionError, match="panda_joint7"):
        load_tolerances(tmp_path / "wrong.yaml", JOINTS)
    (tmp_path / "wrong.yaml").write_text("format: 1\nnormalised_rms: -1")
    with pytest.raises(DescriptionError, match="line 2"):
        load_tolerances(tmp_path / "wrong.yaml")


def test_efforts_that_say_nothing_are_refused_and_joints_without_are_named(tmp_path):
    silent = MOTION._replace(efforts=0 * MOTION.efforts)
    with pytest.raises(RecordingError, match="efforts are constant throughout"):
        checked(write_bag(tmp_path / "silent", messages(silent)))
    told = noisy()
    told.efforts[:, 2] = 0
    found = checked(write_bag(tmp_path / "one", messages(told)))
    assert failed(found) == ["panda_joint3"]
    told.efforts[:, 2] = np.nan
    found = checked(write_bag(tmp_path / "nan", messages(told)))
    assert failed(found) == ["panda_joint3"]
    assert "efforts that were not measured: panda_joint3" in found.notes
    nothing = [message(t, JOINTS, q) for t, q in zip(MOTION.times, MOTION.q, strict=True)]
    with pytest.raises(RecordingError, match="nothing was measured"):
        checked(write_bag(tmp_path / "none", nothing))
    with pytest.raises(RecordingError, match=r"nothing is left to look at\. .*samples are in stretches too short"):
        checked(write_bag(tmp_path / "short", messages(MOTION)[:9]))


def test_csv_with_named_columns_is_read_as_a_bag_is(tmp_path):
    head = ["time", *(f"{name}.{field}" for field in ("effort", "position") for name in JOINTS), "note"]
    rows = [[t + 1.5, *tau, *q] for t, tau, q in zip(MOTION.times, MOTION.efforts, MOTION.q, strict=True)]
    lines = [",".join(head), *(",".join(f"{x:.12g}" for x in row) + ",0" for row in rows)]
    lines[500] = lines[500].replace(",", ",oops,", 1)
    (tmp_path / "run.csv").write_text("\n".join(lines))
    found = checked(tmp_path / "run.csv")
    assert found.passed and max(verdict.joint.rms for verdict in found.verdicts) < 0.1
    assert any("cells that are no numbers" in note for note in found.notes)
    (tmp_path / "bare.csv").write_text("\n".join(lines[1:]))
    with pytest.raises(RecordingError, match="first line has no names of columns"):
        checked(tmp_path / "bare.csv")
    (tmp_path / "other.csv").write_text("time,a,b\n0,1,2\n")
    with pytest.raises(RecordingError, match=r"joint\.position is needed"):
        checked(tmp_path / "other.csv")


def table_lines(motion, times=None, head=None):
    """The lines of a CSV of a motion: times [s], positions and efforts."""
    head = head or ["time", *(f"{name}.{field}" for field in ("position", "effort") for name in JOINTS)]
    rows = np.column_stack([motion.times if times is None else times, motion.q, motion.efforts])[:, : len(head)]
    return [",".join(head), *(",".join(f"{x:.12g}" for x in row) for row in rows)]


def test_broken_lines_of_a_csv_are_left_out_and_counted_and_the_clock_goes_on(tmp_path):
    lines = table_lines(MOTION)
    whole, broken = tmp_path / "whole.csv", tmp_path / "broken.csv"
    whole.write_text("\n".join(lines))
    lines[700:700] = ["", "hello,world", lines[700].replace(lines[700].split(",")[0], "x", 1), "inf," + lines[700]]
    lines[300:300] = [""]
    broken.write_text("\n".join(lines) + "\n\n")
    expected, found = checked(whole), checked(broken)
    assert "6 rows have a time that is no finite number, and were left out" in found.notes
    assert not any("clock" in note or "gaps" in note for note in found.notes)
    assert (found.duration, found.comparison.samples) == (expected.duration, expected.comparison.samples)
    rms = [[verdict.joint.rms for verdict in each.verdicts] for each in (found, expected)]
    assert rms[0] == pytest.approx(rms[1], rel=1e-12)


def test_rows_with_more_cells_than_names_do_not_shift_the_rows_after_them(tmp_path):
    lines = table_lines(MOTION)
    (tmp_path / "twice.csv").write_text("\n".join([lines[0], *(f"{line},{line}" for line in lines[1:])]))
    assert not any("stamp of the one before" in note for note in checked(tmp_path / "twice.csv").notes)


@pytest.mark.parametrize("kind", ["random", "pairs", "pieces"])
@pytest.mark.parametrize("as_bag", [True, False], ids=["bag", "csv"])
def test_uneven_stamps_and_pieces_between_gaps_are_checked_and_what_is_left_out_is_in_the_notes(tmp_path, kind, as_bag):
    motion = noisy(panda_motion(times=uneven_times(kind, 20.0)))
    if as_bag:
        path = write_bag(tmp_path / "run", messages(motion))
    else:
        path = tmp_path / "run.csv"
        path.write_text("\n".join(table_lines(motion)))
    found = checked(path)
    assert found.passed and found.segments == ()
    assert min(verdict.joint.samples for verdict in found.verdicts) > 500
    notes = "; ".join(found.notes)
    assert ("too short to be filtered" in notes) or kind != "pieces"
    assert ("closer to the one before" in notes) or kind == "pieces"


def test_a_recording_of_which_all_pieces_are_too_short_is_refused_with_the_reason(tmp_path):
    """Pieces of 3 and 12 samples, with pauses of 0.3 s: efforts are there, but none can be filtered."""
    times = np.cumsum(np.tile([0.3, 0.009, 0.011, 0.3] + 11 * [0.01], 40))
    path = write_bag(tmp_path / "run", messages(noisy(panda_motion(times=times))))
    with pytest.raises(RecordingError, match=r"look at\. 79 gaps.*600 samples are in stretches too short"):
        checked(path)


def test_a_csv_that_cannot_be_checked_says_what_is_wrong_with_it(tmp_path):
    path, lines = tmp_path / "run.csv", table_lines(MOTION)
    effortless = table_lines(MOTION, head=["time", *(f"{name}.position" for name in JOINTS)])
    for told, expected in (
        (effortless, "no efforts are recorded: nothing was measured; columns panda_joint1.effort, panda_joint2.effort"),
        (lines[:1], r"run.csv: nothing is left to look at\. It has no row"),
        ([lines[0], "x", "y"], "nothing is left to look at.*2 rows have a time that is no finite number"),
        ([lines[0], *lines[:90:-1]], "1 samples of the joints: 8 at least are needed; .* older than the one before"),
    ):
        path.write_text("\n".join(told))
        with pytest.raises(RecordingError, match=expected):
            checked(path)


def test_degrees_and_milliseconds_are_asked_for(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("\n".join(table_lines(MOTION)))
    sound = checked(path).notes
    assert not any("?" in note for note in sound)
    path.write_text("\n".join(table_lines(MOTION._replace(q=np.degrees(MOTION.q)))))
    assert any("beyond the limits of the model (are these degrees?): panda_joint" in note
               for note in checked(path).notes)  # fmt: skip
    path.write_text("\n".join(table_lines(MOTION, times=1000 * MOTION.times)))
    assert (
        "a row comes every 10 s: are its times milliseconds or nanoseconds? Seconds are needed" in checked(path).notes
    )
