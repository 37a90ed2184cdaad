"""Rows of arrays to vectors of columns and back: four columns of the rows of all lanes at a time, by shuffles.

An array has a row for each sample; a vector has one entry of each of several samples, its lanes. Reading entry by entry
would take a load and an insertion for each entry of each sample.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

from robot_dynamics.codegen.jit.schedule import group_bounds
from robot_dynamics.codegen.jit.sincos import vector_type

FOUR = vector_type(4)


def row_pointers(array: int, lanes: int) -> list[str]:
    """IR lines that define %row<array>.<lane>, the row of each lane: sample %first + lane, at most %last."""
    lines = [
        f"%array{array}.at = getelementptr inbounds ptr, ptr %pointers, i64 {array}",
        f"%array{array} = load ptr, ptr %array{array}.at, align 8",
        f"%stride{array}.at = getelementptr inbounds i64, ptr %strides, i64 {array}",
        f"%stride{array} = load i64, ptr %stride{array}.at, align 8",
    ]
    for lane in range(lanes):
        name = f"%row{array}.{lane}"
        lines += [
            f"{name}.next = add i64 %first, {lane}",
            f"{name}.number = call i64 @llvm.smin.i64(i64 {name}.next, i64 %last)",
            f"{name}.offset = mul i64 {name}.number, %stride{array}",
            f"{name} = getelementptr i8, ptr %array{array}, i64 {name}.offset",
        ]
    return lines


def next_block_pointer(array: int, lanes: int) -> list[str]:
    """IR lines that define %next<array>, the row after those of a block, which may lie beyond the array."""
    return [
        f"%next{array}.from.at = getelementptr inbounds ptr, ptr %pointers, i64 {array}",
        f"%next{array}.from = load ptr, ptr %next{array}.from.at, align 8",
        f"%next{array}.stride.at = getelementptr inbounds i64, ptr %strides, i64 {array}",
        f"%next{array}.stride = load i64, ptr %next{array}.stride.at, align 8",
        f"%next{array}.number = add i64 %first, {lanes}",
        f"%next{array}.offset = mul i64 %next{array}.number, %next{array}.stride",
        f"%next{array} = getelementptr i8, ptr %next{array}.from, i64 %next{array}.offset",
    ]


def prefetch_lines(array: int, size: int, lanes: int) -> list[list[str]]:
    """IR lines for each cache line (64 bytes) that the next block has of an array of `size` columns.

    Prefetches beyond the array have no effect.
    """
    return [
        [
            f"%next{array}.{start} = getelementptr i8, ptr %next{array}, i64 {start}",
            f"call void @llvm.prefetch.p0(ptr %next{array}.{start}, i32 0, i32 3, i32 1)",
        ]
        for start in range(0, 8 * size * lanes, 64)
    ]


def read_columns(array: int, size: int, nodes: Mapping[int, int], lanes: int) -> list[str]:
    """IR lines that define %v<node> for {column: node} of an array of `size` columns."""
    if size < 4:
        return [line for column, node in nodes.items() for line in _read_column(array, column, f"%v{node}", lanes)]
    lines: list[str] = []
    remaining = dict(nodes)
    for start, _ in group_bounds(size):
        columns = [column for column in range(start, start + 4) if column in remaining]
        group = {column - start: remaining.pop(column) for column in columns}
        if not group:
            continue
        name = f"%in{array}.{start}"
        rows = _load_rows(lines, array, start, name, lanes)
        _transpose(lines, rows, name, lanes, {column: f"%v{node}" for column, node in group.items()})
    return lines


def write_columns(array: int, start: int, columns: Sequence[str], lanes: int) -> list[str]:
    """IR lines that store vectors, one for each of up to four columns of an array from column `start` on."""
    if len(columns) < 4:
        return [
            line
            for column, value in enumerate(columns, start=start)
            for line in _write_column(array, column, value, lanes)
        ]
    lines: list[str] = []
    V = vector_type(lanes)
    name = f"%out{array}.{start}"
    rows = _transpose(lines, columns, name, lanes, {})
    for lane in range(lanes):
        mask = ", ".join(f"i32 {4 * (lane // 4) + column}" for column in range(4))
        row = f"{name}.row{lane}"
        lines += [
            f"{row} = shufflevector {V} {rows[lane % 4]}, {V} poison, <4 x i32> <{mask}>",
            f"{row}.at = getelementptr inbounds double, ptr %row{array}.{lane}, i64 {start}",
            f"store {FOUR} {row}, ptr {row}.at, align 1",
        ]
    return lines


def _load_rows(lines: list[str], array: int, start: int, name: str, lanes: int) -> list[str]:
    """Four vectors; vector k has four columns of lane k and, of 8 lanes, the same columns of lane k + 4."""
    for lane in range(lanes):
        lines += [
            f"{name}.row{lane}.at = getelementptr inbounds double, ptr %row{array}.{lane}, i64 {start}",
            f"{name}.row{lane} = load {FOUR}, ptr {name}.row{lane}.at, align 1",
        ]
    if lanes == 4:
        return [f"{name}.row{lane}" for lane in range(4)]
    mask = ", ".join(f"i32 {index}" for index in range(8))
    for lane in range(4):
        lower, upper = f"{FOUR} {name}.row{lane}", f"{FOUR} {name}.row{lane + 4}"
        lines.append(f"{name}.rows{lane} = shufflevector {lower}, {upper}, <8 x i32> <{mask}>")
    return [f"{name}.rows{lane}" for lane in range(4)]


def _transpose(lines: list[str], rows: Sequence[str], name: str, lanes: int, names: Mapping[int, str]) -> list[str]:
    """Four vectors with each group of four lanes transposed; `names` has the names of some of the results, by index."""
    V = vector_type(lanes)

    def shuffle(result: str, a: str, b: str, choose: Callable[[int], int]) -> str:
        mask = ", ".join(f"i32 {choose(lane)}" for lane in range(lanes))
        lines.append(f"{result} = shufflevector {V} {a}, {V} {b}, <{lanes} x i32> <{mask}>")
        return result

    def evens(lane: int) -> int:
        return lane - lane % 2 + lanes * (lane % 2)

    def odds(lane: int) -> int:
        return evens(lane) + 1

    def lower(lane: int) -> int:
        return lane if lane % 4 < 2 else lane - 2 + lanes

    def upper(lane: int) -> int:
        return lane + 2 if lane % 4 < 2 else lane + lanes

    a, b, c, d = rows
    low = shuffle(f"{name}.ab0", a, b, evens), shuffle(f"{name}.cd0", c, d, evens)
    high = shuffle(f"{name}.ab1", a, b, odds), shuffle(f"{name}.cd1", c, d, odds)
    halves = (low, lower), (high, lower), (low, upper), (high, upper)
    return [shuffle(names.get(k, f"{name}.t{k}"), *pair, choose) for k, (pair, choose) in enumerate(halves)]


def _read_column(array: int, column: int, name: str, lanes: int) -> Iterator[str]:
    """IR lines that define a vector of one column, entry by entry."""
    value = "poison"
    for lane in range(lanes):
        entry = f"{name}.{lane}"
        result = name if lane == lanes - 1 else f"{entry}.in"
        yield f"{entry}.at = getelementptr inbounds double, ptr %row{array}.{lane}, i64 {column}"
        yield f"{entry} = load double, ptr {entry}.at, align 1"
        yield f"{result} = insertelement {vector_type(lanes)} {value}, double {entry}, i64 {lane}"
        value = result


def _write_column(array: int, column: int, value: str, lanes: int) -> Iterator[str]:
    """IR lines that store a vector to one column, entry by entry."""
    for lane in range(lanes):
        entry = f"%out{array}.{column}.{lane}"
        yield f"{entry} = extractelement {vector_type(lanes)} {value}, i64 {lane}"
        yield f"{entry}.at = getelementptr inbounds double, ptr %row{array}.{lane}, i64 {column}"
        yield f"store double {entry}, ptr {entry}.at, align 1"
