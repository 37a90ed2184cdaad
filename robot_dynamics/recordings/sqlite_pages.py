"""Rows of damaged sqlite3 files: found page by page, without the tree that should lead to them.

A table's rows stand in leaf pages, in cells that say how long they are. Where the file has lost its end, or the pages
between root and leaves, the cells of all leaves that are left can still be read. Source: "Database File Format",
sections 1.3, 1.6 and 2.1, sqlite.org.
"""

from typing import NamedTuple

LEAF_PAGE_TYPE = 0x0D  # a leaf page of a table
HEADER_SIZE = 100  # bytes of the file's own header, on page 1


class Row(NamedTuple):
    """rowid: its number; values: int, bytes, str or None, column by column; floats are None."""

    rowid: int
    values: list


class SqlitePages:
    """The pages of an sqlite3 file: `size` [bytes], `count` of those that are there, `told` by the header."""

    def __init__(self, file):
        self._file = file
        header = file.read(HEADER_SIZE)
        if len(header) < HEADER_SIZE:
            raise ValueError("the header is not whole")
        self.size = int.from_bytes(header[16:18], "big")
        self.size = 65536 if self.size == 1 else self.size
        if self.size < 512 or self.size & (self.size - 1):
            raise ValueError(f"its header tells of pages of {self.size} bytes")
        self.usable = self.size - header[20]
        self.declared_count = int.from_bytes(header[28:32], "big")
        self.count = file.seek(0, 2) // self.size

    def page(self, number):
        """The bytes of page `number`, from 1 on."""
        self._file.seek((number - 1) * self.size)
        return self._file.read(self.size)

    def cells(self):
        """Yield (rowid, page, offset in it) of all cells of leaves, as they stand in the file."""
        for number in range(1, self.count + 1):
            page = self.page(number)
            start = HEADER_SIZE if number == 1 else 0
            if page[start] != LEAF_PAGE_TYPE:
                continue
            pointers = start + 8
            for cell in range(int.from_bytes(page[start + 3 : start + 5], "big")):
                place = pointers + 2 * cell
                offset = int.from_bytes(page[place : place + 2], "big")
                if not place + 2 <= offset < self.usable:
                    break  # no leaf after all: what overflows from other pages may look like one
                try:
                    _, after = _varint(page, offset)
                    rowid, _ = _varint(page, after)
                except IndexError:
                    break
                yield rowid, number, offset

    def row(self, number, offset):
        """The Row of a cell. Raises ValueError where part of it is lost."""
        page = self.page(number)
        try:
            size, after = _varint(page, offset)
            rowid, after = _varint(page, after)
            payload = self._payload(page, after, size)
            return Row(rowid, _values(payload))
        except IndexError:
            raise ValueError("a row is not whole") from None

    def _payload(self, page, start, size):
        """All bytes of a row, those on overflow pages too."""
        largest = self.usable - 35
        if size <= largest:
            return page[start : start + size]
        least = (self.usable - 12) * 32 // 255 - 23
        here = least + (size - least) % (self.usable - 4)
        here = here if here <= largest else least
        parts, left = [page[start : start + here]], size - here
        following = int.from_bytes(page[start + here : start + here + 4], "big")
        while left > 0:
            if not 0 < following <= self.count:
                raise ValueError("a row goes on in a page that is lost")
            page = self.page(following)
            parts.append(page[4 : 4 + min(left, self.usable - 4)])
            left -= self.usable - 4
            following = int.from_bytes(page[:4], "big")
        return b"".join(parts)


def _varint(data, place):
    """(value, place after it) of a number of one to nine bytes."""
    value = 0
    for _ in range(8):
        byte = data[place]
        place += 1
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, place
    return value << 8 | data[place], place + 1


def _values(payload):
    """The columns of a record."""
    end, place = _varint(payload, 0)
    kinds = []
    while place < end:
        kind, place = _varint(payload, place)
        kinds.append(kind)
    values, place = [], end
    for kind in kinds:
        size = (0, 1, 2, 3, 4, 6, 8, 8, 0, 0)[kind] if kind < 10 else (kind - 12) // 2
        content = payload[place : place + size]
        if size < 0 or len(content) < size:
            raise ValueError("a row is not whole")
        place += size
        if kind in (8, 9):
            values.append(kind - 8)
        elif 0 < kind < 7:
            values.append(int.from_bytes(content, "big", signed=True))
        elif kind >= 12:
            values.append(content.decode("utf-8", "replace") if kind % 2 else content)
        else:
            values.append(None)
    return values
