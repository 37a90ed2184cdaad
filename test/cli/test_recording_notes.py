"""Notes on several recordings: each sentence once."""

from robot_dynamics.cli.recording_notes import merge_notes


def test_notes_are_merged_where_only_numbers_differ():
    notes = {
        "runs/2020-02-05.csv": ("26 samples are at the ends", "stamps are up to 1.82 ms late; a period of 5 ms"),
        "runs/2020-02-06.csv": ("28 samples are at the ends",),
        "c": ("104 samples are at the ends", "stamps are up to 0.5 ms late; a period of 5 ms", "efforts: joint_1"),
    }
    assert merge_notes(notes) == [
        "all 3 recordings: 26 to 104 samples are at the ends",
        "runs/2020-02-05.csv, c: stamps are up to 0.5 to 1.82 ms late; a period of 5 ms",
        "c: efforts: joint_1",
    ]


def test_names_are_left_out_or_counted():
    assert merge_notes({"a": ("joint_1 is late",)}) == ["joint_1 is late"]
    assert merge_notes({"a": ("x",), "b": ("x",)}) == ["both recordings: x"]
    assert merge_notes({"a": ("joint_1",), "b": ("joint_2",)}) == ["a: joint_1", "b: joint_2"]  # names are no numbers
    many = {str(number): ("x",) for number in range(5)}
    assert merge_notes({**many, "quiet": ()}) == ["5 of 6 recordings (0 and others): x"]
