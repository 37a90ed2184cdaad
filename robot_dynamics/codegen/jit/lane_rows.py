"""Rows of arrays to vectors in memory and back, as LLVM IR text: functions for arrays of any number of columns."""

from robot_dynamics.codegen.jit.row_transpose import read_columns, row_pointers, write_columns
from robot_dynamics.codegen.jit.sincos import vector_type


def row_functions(lanes: int) -> str:
    """IR of `@read_rows` and `@write_rows`.

    Both take (ptr %pointers, ptr %strides, i64 %first, i64 %last, i64 %size, ptr %vectors): the addresses of the
    pointer to an array of %size columns and of its stride [bytes], the samples of a block, and memory for a vector for
    each column. Lane i has the row of sample %first + i, or of %last if that is less.
    """
    return "\n".join([_read_function(lanes), _write_function(lanes)])


def _read_function(lanes: int) -> str:
    group = read_columns(1, 4, {column: column for column in range(4)}, lanes)
    group += [line for column in range(4) for line in _access(f"store {vector_type(lanes)} %v{column}", column, lanes)]
    single = [*read_columns(2, 1, {0: 4}, lanes), *_access(f"store {vector_type(lanes)} %v4", 4, lanes)]
    return _function("read_rows", group, single, lanes)


def _write_function(lanes: int) -> str:
    load = f"load {vector_type(lanes)}"
    group = [line for column in range(4) for line in _access(f"%v{column} = {load}", column, lanes)]
    group += write_columns(1, 0, [f"%v{column}" for column in range(4)], lanes)
    single = [*_access(f"%v4 = {load}", 4, lanes), *write_columns(2, 0, ["%v4"], lanes)]
    return _function("write_rows", group, single, lanes)


def _access(operation: str, number: int, lanes: int) -> list[str]:
    """IR lines that load or store the vector of one column: 0 to 3 of a group, or 4 for a single one."""
    position = f"add i64 %group, {number}" if number < 4 else "add i64 %column, 0"
    return [
        f"%position{number} = {position}",
        f"%at{number} = getelementptr {vector_type(lanes)}, ptr %vectors, i64 %position{number}",
        f"{operation}, ptr %at{number}, align {8 * lanes}",
    ]


def _function(name: str, group: list[str], single: list[str], lanes: int) -> str:
    """IR of a function that runs lines for each group of four columns, then for each remaining column."""

    def rows(array: int, column: str) -> list[str]:
        return [f"%row{array}.{k} = getelementptr double, ptr %row0.{k}, i64 {column}" for k in range(lanes)]

    head = f"@{name}(ptr %pointers, ptr %strides, i64 %first, i64 %last, i64 %size, ptr %vectors)"
    return "\n".join(
        [
            f"define internal void {head} noinline {{",
            "entry:",
            *row_pointers(0, lanes),
            "%grouped = and i64 %size, -4",
            "br label %groups",
            "groups:",
            "%group = phi i64 [0, %entry], [%next.group, %each.group]",
            "%more.groups = icmp slt i64 %group, %grouped",
            "br i1 %more.groups, label %each.group, label %columns",
            "each.group:",
            *rows(1, "%group"),
            *group,
            "%next.group = add i64 %group, 4",
            "br label %groups",
            "columns:",
            "%column = phi i64 [%grouped, %groups], [%next.column, %each.column]",
            "%more.columns = icmp slt i64 %column, %size",
            "br i1 %more.columns, label %each.column, label %done",
            "each.column:",
            *rows(2, "%column"),
            *single,
            "%next.column = add i64 %column, 1",
            "br label %columns",
            "done:",
            "ret void",
            "}",
        ]
    )
