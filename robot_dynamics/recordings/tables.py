"""CSV with named columns: `time` [s], and for each joint `<joint>.position`, `.velocity`, `.effort`; or a folder with a
file for positions and one for efforts, as drives tell."""

import csv
from itertools import islice

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.joint_samples import JointSample

FIELDS = ("position", "velocity", "effort")
TIME_COLUMNS = ("time", "t", "stamp", "timestamp")
NANOSECONDS_PER_SECOND = 1e9
MAX_PLAUSIBLE_STEP = 1.0  # [s] between rows that is rather a time in other units
ROWS_PER_CHUNK = 20_000  # rows


class Table:
    """A CSV file, or a folder of them, with the interface of a Bag.

    path: a Path; tables: Tables of drives, None for a file with columns of all kinds. Raises RecordingError.
    """

    def __init__(self, path, tables=None):
        self.path, self.tables, self.notes = path, tables, []
        if tables is None:
            self.files = {None: path}
        else:
            told = {field: getattr(tables, field) for field in FIELDS}
            self.files = {field: path / name for field, name in told.items() if name is not None}
        self.columns = {field: self._head(file) for field, file in self.files.items()}
        self.joints = self._joints()
        self.counts = {str(path): None}
        lacking = [] if tables else [f"{name}.effort" for name in self.joints if not self._order["effort"]]
        if lacking:
            self.add_note(f"columns {', '.join(lacking)[:200]} are needed for efforts, and not all of them are there")

    def add_note(self, sentence):
        if sentence not in self.notes:
            self.notes.append(sentence)

    def joint_topics(self, requested=()):
        if requested:
            raise RecordingError(f"{self.path} is a table: it has no topics, leave {', '.join(requested)} out")
        return [str(self.path)]

    def base_topics(self, requested=()):
        raise RecordingError(f"{self.path} is a table: how the base of the robot moves, only a bag tells")

    def samples(self, topics, base=None):
        """Yield the JointSamples, row by row."""
        stamps, number, timeless, told = self._stamps(), 0, 0, []
        for rows in self._chunks():
            for row in rows:
                stamp, number = stamps(row, number), number + 1
                if stamp is None:
                    timeless += 1
                    continue
                told = [*told[:1], stamp]
                yield JointSample(str(self.path), stamp, 0, self.joints, *self._values(row))
        if timeless:
            self.add_note(f"{timeless} rows have a time that is no finite number, and were left out")
        step = (told[-1] - told[0]) / NANOSECONDS_PER_SECOND / (number - timeless - 1) if len(told) > 1 else 0
        if step >= MAX_PLAUSIBLE_STEP:
            self.add_note(
                f"a row comes every {step:.3g} s: are its times milliseconds or nanoseconds? Seconds are needed"
            )

    def _head(self, file):
        try:
            with file.open(newline="", encoding="utf-8-sig") as lines:
                head = next(csv.reader(lines), [])
        except (OSError, UnicodeError, csv.Error) as error:
            raise RecordingError(f"{file} cannot be read as CSV: {error}") from None
        names = [name.strip() for name in head]
        if not names or all(_is_number(name) for name in names):
            raise RecordingError(f"{file}: its first line has no names of columns: time,joint_1.position,... is needed")
        return names

    def _joints(self):
        if self.tables is not None:
            first = self.columns["position"]
            for field, names in self.columns.items():
                if sorted(names) != sorted(first):
                    raise RecordingError(f"{self.files[field]} has columns {names}, those of positions are {first}")
            return tuple(first)
        (columns,) = self.columns.values()
        found = [name.rpartition(".")[0] for name in columns if name.endswith(".position")]
        if not found:
            raise RecordingError(f"{self.path} has columns {', '.join(columns)[:300]}: joint.position is needed")
        return tuple(dict.fromkeys(found))

    def _stamps(self):
        """A function of (row, number of the row) to the stamp [ns], None where the row has none."""
        if self.tables is not None:
            if self.tables.rate is None:
                raise RecordingError(f"{self.path}: `rate` of `tables` is missing, the samples per second")
            step = NANOSECONDS_PER_SECOND / self.tables.rate
            return lambda row, number: round(step * (number + 1))
        columns = self.columns[None]
        clock = next((columns.index(name) for name in TIME_COLUMNS if name in columns), None)
        if clock is None:
            raise RecordingError(f"{self.path} has no column {TIME_COLUMNS[0]} [s]")
        return lambda row, number: (
            round(row[None][clock] * NANOSECONDS_PER_SECOND) if np.isfinite(row[None][clock]) else None
        )

    def _values(self, row):
        empty = np.zeros(0)
        if self.tables is not None:
            return [row[field][self._order[field]] if field in row else empty for field in FIELDS]
        values = row[None]
        return [values[places] if len(places := self._order[field]) == len(self.joints) else empty for field in FIELDS]

    @property
    def _order(self):
        if not hasattr(self, "_places"):
            if self.tables is not None:
                self._places = {field: [names.index(name) for name in self.joints]
                                for field, names in self.columns.items()}  # fmt: skip
            else:
                columns = self.columns[None]
                self._places = {field: [columns.index(f"{name}.{field}") for name in self.joints
                                        if f"{name}.{field}" in columns] for field in FIELDS}  # fmt: skip
        return self._places

    def _chunks(self):
        """Lists of {field: (columns,) numbers}, nan where there is none."""
        files = {field: file.open(newline="", encoding="utf-8-sig") for field, file in self.files.items()}
        try:
            readers = {field: csv.reader(lines) for field, lines in files.items()}
            for reader in readers.values():
                next(reader, None)
            while True:
                parts = {
                    field: self._numbers(field, list(islice(reader, ROWS_PER_CHUNK)))
                    for field, reader in readers.items()
                }
                rows = min(len(part) for part in parts.values())
                if rows != max(len(part) for part in parts.values()):
                    self.add_note("the files have different numbers of rows: what is beyond the shortest is left out")
                if not rows:
                    return
                yield [{field: part[number] for field, part in parts.items()} for number in range(rows)]
        finally:
            for lines in files.values():
                lines.close()

    def _numbers(self, field, rows):
        width = len(self.columns[field])
        if all(len(row) == width for row in rows):  # else numbers of one row would come into the next
            try:
                return np.array(rows, dtype=float).reshape(-1, width)
            except ValueError:
                pass
        cut = [[cell if _is_number(cell) else "nan" for cell in (row + [""] * width)[:width]] for row in rows]
        self.add_note(f"{self.files[field].name}: cells that are no numbers were taken as missing")
        return np.array(cut, dtype=float).reshape(-1, width)


def _is_number(cell):
    try:
        float(cell)
    except ValueError:
        return False
    return True
