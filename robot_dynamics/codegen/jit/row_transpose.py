"""Rows of arrays to vectors of columns and back: four columns of all lanes' rows at a time, by shuffles in registers.

Sample after sample, an array has a row for each; a vector has one entry of as many samples as it has lanes. Reading
entry by entry would take a load and an insertion for each entry of each sample.
"""

from robot_dynamics.codegen.jit.sincos import vector_type

FOUR = vector_type(4)


def row_pointers(array, lanes):
    """IR lines: %row<array>.<lane>, the row of each lane: sample %first + lane, but %last at most."""
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


def next_block_pointer(array, lanes):
    """IR lines: %next<array>, the row after those of a block, whether it is there or not."""
    return [
        f"%next{array}.from.at = getelementptr inbounds ptr, ptr %pointers, i64 {array}",
        f"%next{array}.from = load ptr, ptr %next{array}.from.at, align 8",
        f"%next{array}.stride.at = getelementptr inbounds i64, ptr %strides, i64 {array}",
        f"%next{array}.stride = load i64, ptr %next{array}.stride.at, align 8",
        f"%next{array}.number = add i64 %first, {lanes}",
        f"%next{array}.offset = mul i64 %next{array}.number, %next{array}.stride",
        f"%next{array} = getelementptr i8, ptr %next{array}.from, i64 %next{array}.offset",
    ]


def prefetch_lines(array, size, lanes):
    """For each line of the cache [64 bytes] that the next block has of an array of `size` columns, IR lines that fetch
    it. A fetch from where nothing is does nothing."""
    return [
        [
            f"%next{array}.{start} = getelementptr i8, ptr %next{array}, i64 {start}",
            f"call void @llvm.prefetch.p0(ptr %next{array}.{start}, i32 0, i32 3, i32 1)",
        ]
        for start in range(0, 8 * size * lanes, 64)
    ]


def group_starts(size):
    """The columns at which groups of four begin; the last group overlaps the one before it."""
    return sorted({min(start, size - 4) for start in range(0, size, 4)}) if size >= 4 else []


def read_columns(array, size, nodes, lanes):
    """IR lines: %v<node> for {column: node} of an array of `size` columns."""
    if size < 4:
        return [line for column, node in nodes.items() for line in _gathered(array, column, f"%v{node}", lanes)]
    lines, left = [], dict(nodes)
    for start in group_starts(size):
        group = {column - start: left.pop(column) for column in range(start, start + 4) if column in left}
        if not group:
            continue
        name = f"%in{array}.{start}"
        quarters = _loaded(lines, array, start, name, lanes)
        _transposed(lines, quarters, name, lanes, {place: f"%v{node}" for place, node in group.items()})
    return lines


def write_columns(array, columns, lanes):
    """IR lines that store vectors, one for each column of an array."""
    size = len(columns)
    if size < 4:
        return [line for place, value in enumerate(columns) for line in _scattered(array, place, value, lanes)]
    lines, V = [], vector_type(lanes)
    for start in group_starts(size):
        name = f"%out{array}.{start}"
        rows = _transposed(lines, columns[start : start + 4], name, lanes, {})
        for lane in range(lanes):
            mask = ", ".join(f"i32 {4 * (lane // 4) + place}" for place in range(4))
            row = f"{name}.row{lane}"
            lines += [
                f"{row} = shufflevector {V} {rows[lane % 4]}, {V} poison, <4 x i32> <{mask}>",
                f"{row}.at = getelementptr inbounds double, ptr %row{array}.{lane}, i64 {start}",
                f"store {FOUR} {row}, ptr {row}.at, align 1",
            ]
    return lines


def _loaded(lines, array, start, name, lanes):
    """Four vectors, of which the k-th has four columns of lane k, then (of 8 lanes) four of lane k + 4."""
    for lane in range(lanes):
        lines += [
            f"{name}.row{lane}.at = getelementptr inbounds double, ptr %row{array}.{lane}, i64 {start}",
            f"{name}.row{lane} = load {FOUR}, ptr {name}.row{lane}.at, align 1",
        ]
    if lanes == 4:
        return [f"{name}.row{lane}" for lane in range(4)]
    mask = ", ".join(f"i32 {place}" for place in range(8))
    for lane in range(4):
        lower, upper = f"{FOUR} {name}.row{lane}", f"{FOUR} {name}.row{lane + 4}"
        lines.append(f"{name}.rows{lane} = shufflevector {lower}, {upper}, <8 x i32> <{mask}>")
    return [f"{name}.rows{lane}" for lane in range(4)]


def _transposed(lines, rows, name, lanes, names):
    """Each group of four lanes of four vectors, transposed. names: {place: name} of results that have one."""
    V, places = vector_type(lanes), range(lanes)

    def shuffle(result, a, b, choose):
        mask = ", ".join(f"i32 {choose(place)}" for place in places)
        lines.append(f"{result} = shufflevector {V} {a}, {V} {b}, <{lanes} x i32> <{mask}>")
        return result

    def evens(place):
        return place - place % 2 + lanes * (place % 2)

    def odds(place):
        return evens(place) + 1

    def lower(place):
        return place if place % 4 < 2 else place - 2 + lanes

    def upper(place):
        return place + 2 if place % 4 < 2 else place + lanes

    a, b, c, d = rows
    low = shuffle(f"{name}.ab0", a, b, evens), shuffle(f"{name}.cd0", c, d, evens)
    high = shuffle(f"{name}.ab1", a, b, odds), shuffle(f"{name}.cd1", c, d, odds)
    halves = (low, lower), (high, lower), (low, upper), (high, upper)
    return [shuffle(names.get(place, f"{name}.t{place}"), *pair, choose) for place, (pair, choose) in enumerate(halves)]


def _gathered(array, column, name, lanes):
    value = "poison"
    for lane in range(lanes):
        one = f"{name}.{lane}"
        result = name if lane == lanes - 1 else f"{one}.in"
        yield f"{one}.at = getelementptr inbounds double, ptr %row{array}.{lane}, i64 {column}"
        yield f"{one} = load double, ptr {one}.at, align 1"
        yield f"{result} = insertelement {vector_type(lanes)} {value}, double {one}, i64 {lane}"
        value = result


def _scattered(array, column, value, lanes):
    for lane in range(lanes):
        one = f"%out{array}.{column}.{lane}"
        yield f"{one} = extractelement {vector_type(lanes)} {value}, i64 {lane}"
        yield f"{one}.at = getelementptr inbounds double, ptr %row{array}.{lane}, i64 {column}"
        yield f"store double {one}, ptr {one}.at, align 1"
