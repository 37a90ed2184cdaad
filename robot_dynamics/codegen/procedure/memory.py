"""Arrays of a procedure in memory, whose entries are read and assigned with constant indices or with counters.

In a function of several lanes each entry is a vector. What is stored changes only the lanes that are computed then.
"""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.codegen.jit.sincos import splat
from robot_dynamics.codegen.procedure.ir_types import ir_type
from robot_dynamics.codegen.procedure.procedure_errors import LanesError
from robot_dynamics.codegen.procedure.symbols import (
    Condition,
    Counter,
    Number,
    choose,
    counter_operand,
    counter_range,
    number_operand,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.procedure.function_text import FunctionText


class Memory:
    """An array of doubles in memory, row by row.

    Operations read all of its entries. Indices may be Counters for the first axes; with constant indices any part can
    be read.

    Attributes
    ----------
    text : FunctionText
    address : str
        Operand with the address of the first number.
    shape : tuple of int
    mask : str or None
        The lanes for which the array was made: no other lane reads it.
    """

    def __init__(self, text: FunctionText, address: str, shape: tuple[int, ...], mask: str | None = None) -> None:
        self.text = text
        self.address = address
        self.shape = shape
        self.mask = mask

    @property
    def size(self) -> int:
        """Number of entries."""
        return prod(self.shape)

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def reshape(self, *shape: int) -> Memory:
        """The same memory as an array of another shape."""
        if prod(shape) != self.size:
            raise ValueError(f"an array of {self.size} entries has no shape {shape}")
        return Memory(self.text, self.address, shape, self.mask)

    @property
    def is_partly_stored(self) -> bool:
        """Whether what is stored now changes only some of the lanes that have the array."""
        return self.text.mask != self.mask

    def values(self) -> ScalarArray:
        """All entries, read now."""
        entries: ScalarArray = self._read(np.arange(self.size).reshape(self.shape))
        return entries

    def _read(self, positions: Any) -> Any:
        if np.ndim(positions) == 0:
            return self._load(int(positions))
        entries = np.empty(np.shape(positions), dtype=object)
        for index, position in np.ndenumerate(positions):
            entries[index] = self._load(int(position))
        return entries

    def __getitem__(self, index: Any) -> Any:
        position = self._position(index)
        if isinstance(position, Counter):
            return self._load(position)
        if isinstance(position, tuple):  # rows from a counter on
            first, shape = position
            return Memory(self.text, self._address(first), shape, self.mask)
        return self._read(position)

    def __setitem__(self, index: Any, value: Any) -> None:
        position = self._position(index)
        if isinstance(position, Counter):
            self._store(position, value)
            return
        if isinstance(position, tuple):
            self[index].copy_from(value)
            return
        values = np.broadcast_to(as_values(value), np.shape(position))
        for entry, number in zip(np.ravel(position), values.ravel(), strict=True):
            self._store(int(entry), number)

    def copy_from(self, value: Any) -> None:
        """Store all entries of an array of the same shape."""
        self[(slice(None),) * self.ndim] = value

    def _position(self, index: Any) -> Any:
        """The position of an index: a Counter, (Counter, shape) of a row, or an array of constant positions."""
        indices = index if isinstance(index, tuple) else (index,)
        if not any(isinstance(entry, Counter) for entry in indices):
            return np.arange(self.size).reshape(self.shape)[index]
        if len(indices) > self.ndim:
            raise TypeError(f"an array of the shape {self.shape} has {self.ndim} indices, not {len(indices)}")
        first: Any = 0
        for axis, entry in enumerate(indices):
            first = first + self._checked(entry, axis) * prod(self.shape[axis + 1 :])
        rest = self.shape[len(indices) :]
        return (first, rest) if rest else first

    def _checked(self, entry: Any, axis: int) -> Any:
        """An index beside a Counter, or the Counter; whether it lies within the axis is checked."""
        if not isinstance(entry, Counter | int | np.integer) or isinstance(entry, bool):
            raise TypeError(f"an index beside a number of a loop is {entry!r:.40}: it must be an integer")
        size = self.shape[axis]
        if not isinstance(entry, Counter) and -size <= entry < 0:
            return entry + size
        self.text.index_checks.require(counter_range(entry), size, self.text.location)
        return entry

    def _load(self, position: int | Counter) -> Number:
        text = self.text
        if isinstance(position, Counter) and position.lanes > 1:
            operands = f"{self._addresses(position)}, i32 8, {self._mask()}, {text.number_type} zeroinitializer"
            return Number(
                text,
                text.assign(
                    f"call {text.number_type} @llvm.masked.gather.v{text.lanes}f64.v{text.lanes}p0({operands})"
                ),
            )
        address = self._address(position)
        return Number(text, text.assign(f"load {text.number_type}, ptr {address}, align {8 * text.lanes}"))

    def _store(self, position: int | Counter, value: object) -> None:
        text = self.text
        operand = f"{text.number_type} {number_operand(value, text.lanes)}"
        if isinstance(position, Counter) and position.lanes > 1:
            operands = f"{operand}, {self._addresses(position)}, i32 8, {self._mask()}"
            text.append(f"call void @llvm.masked.scatter.{self._suffix}({operands})")
            return
        address = self._address(position)
        if self.is_partly_stored:
            assert text.mask is not None
            before = Number(text, text.assign(f"load {text.number_type}, ptr {address}, align {8 * text.lanes}"))
            operand = f"{text.number_type} {choose(Condition(text, text.mask), value, before).operand}"
        text.append(f"store {operand}, ptr {address}, align {8 * text.lanes}")

    def _address(self, position: int | Counter) -> str:
        if isinstance(position, int) and position == 0:
            return self.address
        if isinstance(position, Counter) and position.lanes > 1:
            raise LanesError("rows of an array whose number is not the same in all lanes")
        at = f"ptr {self.address}, i64 {counter_operand(position)}"
        return self.text.assign(f"getelementptr {self.text.number_type}, {at}")

    def _addresses(self, position: Counter) -> str:
        """A vector of the address of an entry in each lane, as an operand with its type."""
        text, lanes = self.text, self.text.lanes
        integers = ir_type("i64", lanes)
        own = ", ".join(f"i64 {lane}" for lane in range(lanes))
        numbers = text.assign(f"add {integers} {(position * lanes).operand}, <{own}>")
        pointers = text.assign(f"getelementptr double, ptr {self.address}, {integers} {numbers}")
        return f"{ir_type('ptr', lanes)} {pointers}"

    @property
    def _suffix(self) -> str:
        """The end of the names of functions of LLVM that access an address in each lane."""
        return f"{self.text.number_suffix}.v{self.text.lanes}p0"

    def _mask(self) -> str:
        lanes = self.text.lanes
        return f"{ir_type('i1', lanes)} {self.text.mask or splat('true', 'i1')}"

    def __array__(self, *_: object, **__: object) -> ScalarArray:
        return self.values()

    @property
    def T(self) -> ScalarArray:
        """The transpose."""
        transposed: ScalarArray = self.values().T
        return transposed


def _delegate(name: str) -> Callable[..., Any]:
    def operation(self: Memory, *others: Any) -> Any:
        return getattr(self.values(), name)(*(as_values(other) for other in others))

    return operation


for _name in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv", "matmul", "rmatmul", "neg", "pow"):
    setattr(Memory, f"__{_name}__", _delegate(f"__{_name}__"))
for _name in ("lt", "le", "gt", "ge"):
    setattr(Memory, f"__{_name}__", _delegate(f"__{_name}__"))
Memory.__array_ufunc__ = None  # type: ignore[attr-defined]  # an array leaves operations with Memory to Memory


def as_values(value: Any) -> Any:
    """A value with the entries of Memory read now."""
    return value.values() if isinstance(value, Memory) else value
