"""Rows of damaged sqlite3 files, read page by page without the tree that leads to them.

Robots that lose power leave such files, Python's sqlite3 module has no `.recover`, and the `sqlite3` command is often
not installed: hence this module.

A table's rows are in leaf pages, in cells with a length. Where the file has lost its end, or the pages between root and
leaves, the cells of all remaining leaves are readable. Source: "Database File Format", sections 1.3, 1.6 and 2.1,
sqlite.org.
"""

from collections import Counter
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple, TypeAlias

LEAF_PAGE_TYPE = 0x0D  # a leaf page of a table
HEADER_SIZE = 100  # bytes of the file's own header, on page 1
MIN_PAGE_SIZE = 512  # [bytes]
MAX_RELEASES = 8  # of an overflow page by false rows; with more, false rows would read a long chain without end
VALUE_SIZES = (0, 1, 2, 3, 4, 6, 8, 8, 0, 0)  # [bytes] of the serial types 0 to 9

Value: TypeAlias = int | bytes | str | None


class Cell(NamedTuple):
    """Position of a row: its rowid, the number of its page, the offset [bytes] in the page."""

    rowid: int
    page: int
    offset: int


class SqlitePages:
    """The pages of an sqlite3 file.

    Attributes
    ----------
    size : of a page [bytes].
    usable : part of a page that holds content [bytes].
    declared_count : number of pages that the header states.
    count : number of complete pages in the file.
    """

    def __init__(self, file: BinaryIO) -> None:
        """Read the header. Raises ValueError where it is incomplete or invalid."""
        self._file = file
        header = file.read(HEADER_SIZE)
        if len(header) < HEADER_SIZE:
            raise ValueError("the header is incomplete")
        size = int.from_bytes(header[16:18], "big")
        self.size = 65536 if size == 1 else size
        if self.size < MIN_PAGE_SIZE or self.size & (self.size - 1):
            raise ValueError(f"the header states pages of {self.size} bytes")
        self.usable = self.size - header[20]
        self.declared_count = int.from_bytes(header[28:32], "big")
        self.count = file.seek(0, 2) // self.size
        self._owners: dict[int, Cell] = {}  # rows of overflow pages, each of which belongs to one row
        self._releases: Counter[int] = Counter()  # by overflow page

    def page(self, number: int) -> bytes:
        """The bytes of a page; the first has number 1."""
        self._file.seek((number - 1) * self.size)
        return self._file.read(self.size)

    def cells(self) -> Iterator[Cell]:
        """Yield the cells of all leaves, in the order of the file."""
        for number in range(1, self.count + 1):
            page = self.page(number)
            start = HEADER_SIZE if number == 1 else 0
            if page[start] != LEAF_PAGE_TYPE:
                continue
            first_pointer = start + 8
            for index in range(int.from_bytes(page[start + 3 : start + 5], "big")):
                pointer = first_pointer + 2 * index
                offset = int.from_bytes(page[pointer : pointer + 2], "big")
                if not pointer + 2 <= offset < self.usable:
                    break  # an overflow page, which may look like a leaf
                try:
                    _, rowid_position = _varint(page, offset)
                    rowid, _ = _varint(page, rowid_position)
                except IndexError:
                    break
                yield Cell(rowid, number, offset)

    def row(self, cell: Cell) -> list[Value]:
        """The values of a row, column by column; None for floats and NULL.

        Raises ValueError where a part of the row is lost.
        """
        page = self.page(cell.page)
        visited: set[int] = set()
        try:
            size, position = _varint(page, cell.offset)
            _, position = _varint(page, position)  # the rowid
            return _values(self._payload(cell, page, position, size, visited))
        except IndexError:
            self._release(visited)
            raise ValueError("the row is incomplete") from None
        except ValueError:
            self._release(visited)
            raise

    def _release(self, overflow_pages: set[int]) -> None:
        """Let another row have the overflow pages of a row that cannot be read."""
        for number in overflow_pages:
            self._releases[number] += 1
            if self._releases[number] <= MAX_RELEASES:
                del self._owners[number]

    def _payload(self, cell: Cell, page: bytes, start: int, size: int, visited: set[int]) -> bytes:
        """The `size` bytes of a row from `start` on its page, and on overflow pages (section 1.6).

        visited: receives the numbers of the overflow pages.
        """
        if size > self.count * self.size:
            raise ValueError("the row is longer than the file")
        largest = self.usable - 35
        if size <= largest:
            return page[start : start + size]
        smallest = (self.usable - 12) * 32 // 255 - 23
        local = smallest + (size - smallest) % (self.usable - 4)
        local = local if local <= largest else smallest
        parts = [page[start : start + local]]
        remaining = size - local
        overflow = int.from_bytes(page[start + local : start + local + 4], "big")
        while remaining > 0:
            if not 0 < overflow <= self.count:
                raise ValueError("the row continues on a page that is lost")
            if overflow in visited or self._owners.setdefault(overflow, cell) != cell:
                raise ValueError("the row continues on a page of another row, or on its own again")
            visited.add(overflow)
            page = self.page(overflow)
            parts.append(page[4 : 4 + min(remaining, self.usable - 4)])
            remaining -= self.usable - 4
            overflow = int.from_bytes(page[:4], "big")
        return b"".join(parts)


def _varint(data: bytes, position: int) -> tuple[int, int]:
    """A number of one to nine bytes, and the position after it."""
    value = 0
    for _ in range(8):
        byte = data[position]
        position += 1
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, position
    return value << 8 | data[position], position + 1


def _values(payload: bytes) -> list[Value]:
    """The columns of a record (section 2.1)."""
    header_size, position = _varint(payload, 0)
    serial_types = []
    while position < header_size:
        serial_type, position = _varint(payload, position)
        serial_types.append(serial_type)
    values = []
    position = header_size
    for serial_type in serial_types:
        size = VALUE_SIZES[serial_type] if serial_type < 10 else (serial_type - 12) // 2
        content = payload[position : position + size]
        if size < 0 or len(content) < size:
            raise ValueError("the row is incomplete")
        position += size
        values.append(_value(serial_type, content))
    return values


def _value(serial_type: int, content: bytes) -> Value:
    if serial_type in (8, 9):
        return serial_type - 8
    if 0 < serial_type < 7:
        return int.from_bytes(content, "big", signed=True)
    if serial_type >= 12:
        return content.decode("utf-8", "replace") if serial_type % 2 else content
    return None
