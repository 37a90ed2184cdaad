"""CSV files with named columns: `time` [s], and for each joint `<joint>.position`, `.velocity`, `.effort`.

Or a folder with one file for positions and one for efforts, as controllers of drives write them: each file has a column
for each motor, and the rows are equally spaced in time.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from itertools import islice, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TextIO, TypeAlias

import numpy as np

from robot_dynamics.array_types import Array
from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.joint_samples import JointSample
from robot_dynamics.recordings.messages import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from robot_dynamics.recordings.drives import TableFiles

Field: TypeAlias = Literal["position", "velocity", "effort"]
Row: TypeAlias = dict[Field | None, Array]  # the numbers (columns,) of a row of each file

SOURCE = ""  # of the samples of a table, in the place of a topic: it has one only, which needs no name
FIELDS: tuple[Field, ...] = ("position", "velocity", "effort")
TIME_COLUMNS = ("time", "t", "stamp", "timestamp")
MAX_TIME = 9e9  # [s] whose nanoseconds have 64 bits
SEPARATORS = {";": "semicolons", "\t": "tabs"}  # that other programs write in the place of commas
MAX_COLUMN_NAMES = 8  # listed in one note or message
MAX_PLAUSIBLE_STEP = 1.0  # [s] between rows; longer steps suggest that times have another unit
MAX_COLUMNS = 10_000  # of a file; robots have tens of joints
CELLS_PER_CHUNK = 1_000_000  # of each file, in memory at once
ROWS_PER_CHUNK = 20_000  # at most
UNDECODED = "\ufffd"
NO_VALUES = np.zeros(0)


class Table:
    """A CSV file, or a folder of CSV files, with the interface of a Bag.

    Parameters
    ----------
    path : of the file or folder.
    tables : names of the files of a folder; None: a file with columns of all signals.

    Attributes
    ----------
    files : {field: path}, or {None: path} of a file with all signals.
    joints : names of the joints or motors.
    counts : {path: None}: the number of rows is not known before reading.
    notes : sentences on damage; complete after `samples` was read.

    Raises
    ------
    RecordingError
        Where a file cannot be read or lacks columns.
    """

    def __init__(self, path: Path, tables: TableFiles | None = None) -> None:
        self.path = path
        self.tables = tables
        self.notes: list[str] = []
        self.counts: dict[str, int | None] = {str(path): None}
        self.files: dict[Field | None, Path] = {None: path} if tables is None else _table_paths(path, tables)
        self._column_names = {field: read_column_names(file) for field, file in self.files.items()}
        self.joints = self._find_joints()
        self._columns = {field: self._find_columns(field) for field in FIELDS}
        self._missing_cells: dict[str, Counter[str]] = {"cells are empty": Counter(), "cells have no number": Counter()}
        self._skipped_lines: Counter[str] = Counter()  # by the name of the file
        self._skip_reasons: dict[str, str] = {}
        if tables is None and len(self._columns["effort"]) < len(self.joints):
            self._note_missing_efforts()

    def add_note(self, sentence: str) -> None:
        """Append a sentence to the notes, once."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def _note_missing_efforts(self) -> None:
        names = set(self._column_names[None])
        missing = [name for joint in self.joints if (name := f"{joint}.effort") not in names]
        if len(missing) == len(self.joints):
            self.add_note(f"columns {', '.join(missing)[:200]} are needed for efforts, and none of them is there")
        else:
            self.add_note(f"no efforts are read, because columns are missing: {', '.join(missing)[:200]}")

    def joint_topics(self, requested: Sequence[str] = ()) -> list[str]:
        """The path, in the place of a topic. Raises RecordingError where topics are requested."""
        if requested:
            raise RecordingError(f"{self.path} is a table: it has no topics, leave {', '.join(requested)} out")
        return [str(self.path)]

    def base_topics(self, requested: Collection[str] = ()) -> list[str]:
        """Raises RecordingError: a table has no odometry."""
        raise RecordingError(f"{self.path} is a table: only a bag has the motion of the base of the robot")

    def samples(self, topics: Collection[str], base: str | None = None) -> Generator[JointSample, None, None]:
        """Yield the joint samples, row by row. Raises RecordingError where times are missing."""
        row_stamp = self._make_row_stamp()
        for counts in self._missing_cells.values():
            counts.clear()
        self._skipped_lines.clear()
        row_number = 0
        rows_without_time = 0
        first_stamp: int | None = None
        last_stamp = 0
        for rows in self._chunks():
            for row in rows:
                stamp = row_stamp(row, row_number)
                row_number += 1
                if stamp is None:
                    rows_without_time += 1
                    continue
                first_stamp = stamp if first_stamp is None else first_stamp
                last_stamp = stamp
                position, velocity, effort = (self._signal(row, field) for field in FIELDS)
                yield JointSample(SOURCE, stamp, 0, self.joints, position, velocity, effort)
        self._note_missing_cells()
        for name, count in self._skipped_lines.items():
            self.add_note(f"{name}: {count} lines cannot be read and were skipped ({self._skip_reasons[name]})")
        if rows_without_time:
            self.add_note(
                f"{rows_without_time} rows have a time that is no finite number, or beyond {MAX_TIME:g} s, and were "
                "skipped"
            )
        steps = row_number - rows_without_time - 1
        if first_stamp is not None and steps > 0:
            self._note_implausible_step((last_stamp - first_stamp) / NANOSECONDS_PER_SECOND / steps)

    def _note_missing_cells(self) -> None:
        for what, counts in self._missing_cells.items():
            columns = [f"{name} ({count} row{'s' * (count > 1)})" for name, count in counts.items()]
            if columns:
                more = len(columns) - MAX_COLUMN_NAMES
                listed = ", ".join(columns[:MAX_COLUMN_NAMES]) + (f" and {more} more columns" if more > 0 else "")
                self.add_note(f"{what} and were taken as missing: {listed}")

    def _note_implausible_step(self, step: float) -> None:
        if step >= MAX_PLAUSIBLE_STEP:
            self.add_note(
                f"rows are {step:.3g} s apart: are the times in milliseconds or nanoseconds? Seconds are needed"
            )

    def _find_joints(self) -> tuple[str, ...]:
        if self.tables is not None:
            first = self._column_names["position"]
            for field, names in self._column_names.items():
                if sorted(names) != sorted(first):
                    raise RecordingError(f"{self.files[field]} has columns {names}, those of positions are {first}")
            return tuple(first)
        columns = self._column_names[None]
        joints = [name.rpartition(".")[0] for name in columns if name.endswith(".position")]
        if not joints:
            more = len(columns) - MAX_COLUMN_NAMES
            shown = ", ".join(columns[:MAX_COLUMN_NAMES]) + (f" and {more} more" if more > 0 else "")
            raise RecordingError(
                f"{self.path} has no column <joint>.position: columns time, <joint>.position and <joint>.effort are "
                f"needed for each joint, such as elbow.position; it has {shown}"
            )
        return tuple(dict.fromkeys(joints))

    def _find_columns(self, field: Field) -> list[int]:
        """Columns of a field in the order of the joints; fewer than joints where the field is incomplete."""
        if self.tables is not None:
            names = self._column_names.get(field, [])
            numbers = _first_columns(names)
            return [numbers[name] for name in self.joints] if names else []
        numbers = _first_columns(self._column_names[None])
        return [numbers[column] for name in self.joints if (column := f"{name}.{field}") in numbers]

    def _make_row_stamp(self) -> Callable[[Row, int], int | None]:
        """A function from a row and its number to its stamp [ns], None where the row has none."""
        if self.tables is not None:
            if self.tables.rate is None:
                raise RecordingError(f"{self.path}: `rate` of `tables` is missing, the samples per second")
            step = NANOSECONDS_PER_SECOND / self.tables.rate
            return lambda row, number: round(step * (number + 1))
        names = self._column_names[None]
        column = next((names.index(name) for name in TIME_COLUMNS if name in names), None)
        if column is None:
            raise RecordingError(f"{self.path} has no column {TIME_COLUMNS[0]} [s]")

        def row_stamp(row: Row, number: int) -> int | None:
            time = row[None][column]
            return round(time * NANOSECONDS_PER_SECOND) if abs(time) <= MAX_TIME else None

        return row_stamp

    def _signal(self, row: Row, field: Field) -> Array:
        """The values (n,) of a field in a row, empty where the field is missing or incomplete."""
        columns = self._columns[field]
        if len(columns) != len(self.joints):
            return NO_VALUES
        return row[field if self.tables is not None else None][columns]

    def _chunks(self) -> Iterator[list[Row]]:
        """Yield lists of rows; nan where a cell has no number."""
        files = {field: _open_text(file) for field, file in self.files.items()}
        largest_width = max(map(len, self._column_names.values()))
        row_count = max(1, min(ROWS_PER_CHUNK, CELLS_PER_CHUNK // largest_width))
        try:
            tables = {field: self._rows(field, lines) for field, lines in files.items()}
            while True:
                parts = {field: self._numbers(field, list(islice(rows, row_count))) for field, rows in tables.items()}
                count = min(len(part) for part in parts.values())
                if count != max(len(part) for part in parts.values()):
                    self.add_note("the files have different numbers of rows: rows beyond the shortest were skipped")
                if not count:
                    return
                yield [{field: part[number] for field, part in parts.items()} for number in range(count)]
        finally:
            for lines in files.values():
                lines.close()

    def _rows(self, field: Field | None, lines: TextIO) -> Iterator[list[str]]:
        """Yield the rows of a file without the first, cut to the width of the first; empty rows for unreadable lines.

        Rows of a file with times are left out where they are unreadable; other files need them, as their rows are
        equally spaced.
        """
        width = len(self._column_names[field])
        reader = csv.reader(lines)
        next(reader, None)
        name = self.files[field].name
        while True:
            line_number = reader.line_num
            try:
                row = next(reader)
            except StopIteration:
                return
            except csv.Error as error:  # the reader goes on with the next line
                count = reader.line_num - line_number
                self._skipped_lines[name] += count
                self._skip_reasons.setdefault(name, f"the first one is line {line_number + 1}: {error}")
                if self.tables is not None:
                    yield from repeat([], count)
                continue
            yield row[:width]

    def _numbers(self, field: Field | None, rows: list[list[str]]) -> Array:
        """The cells of rows as numbers (len(rows), columns)."""
        width = len(self._column_names[field])
        if all(len(row) == width for row in rows):  # else cells of one row would move to the next
            try:
                return np.array(rows, dtype=float).reshape(-1, width)
            except ValueError:
                pass
        padded = (row + [""] * (width - len(row)) for row in rows)
        cells = [
            [cell if _is_number(cell) else self._missing_cell(field, k, cell) for k, cell in enumerate(row)]
            for row in padded
        ]
        return np.array(cells, dtype=float).reshape(-1, width)

    def _missing_cell(self, field: Field | None, column: int, cell: str) -> str:
        """Count a cell without a number; returns the cell that takes its place."""
        name = self._column_names[field][column]
        what = "cells have no number" if cell.strip() else "cells are empty"
        self._missing_cells[what][name if field is None else f"{self.files[field].name}: {name}"] += 1
        return "nan"


def _first_columns(names: Sequence[str]) -> dict[str, int]:
    """{name: number of the first column with it}."""
    numbers: dict[str, int] = {}
    for number, name in enumerate(names):
        numbers.setdefault(name, number)
    return numbers


def _table_paths(folder: Path, tables: TableFiles) -> dict[Field | None, Path]:
    """{field: path} of the files of a folder."""
    names: dict[Field, str | None] = {
        "position": tables.position,
        "velocity": tables.velocity,
        "effort": tables.effort,
    }
    return {field: folder / name for field, name in names.items() if name is not None}


def read_column_names(file: Path) -> list[str]:
    """Return the names of the columns, in the first line of a CSV file. Raises RecordingError."""
    try:
        with _open_text(file) as lines:
            header = next(csv.reader(lines), [])
    except (OSError, csv.Error) as error:
        raise RecordingError(f"{file} cannot be read as CSV: {error}") from None
    names = [name.strip() for name in header]
    if len(names) > MAX_COLUMNS:
        raise RecordingError(f"{file} has {len(names)} columns: at most {MAX_COLUMNS} can be read")
    undecoded = [name for name in names if UNDECODED in name]
    if undecoded:
        raise RecordingError(f"{file} cannot be read as CSV: the column {undecoded[0][:100]!r} is not UTF-8")
    for separator, plural in SEPARATORS.items():
        if len(names) == 1 and separator in header[0]:
            raise RecordingError(
                f"{file}: the columns are separated by {plural}. Separate them by commas, and write numbers with a "
                "decimal point, as 1.5"
            )
    if not names or all(_is_number(name) for name in names):
        raise RecordingError(f"{file}: the first line has no column names: time,joint_1.position,... is needed")
    return names


def _open_text(file: Path) -> TextIO:
    """Open a file; bytes that are not UTF-8 become `UNDECODED`, so that their cells are no numbers."""
    return file.open(newline="", encoding="utf-8-sig", errors="replace")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
