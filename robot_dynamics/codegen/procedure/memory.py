"""Arrays of a procedure in memory, whose entries are read and assigned with constant indices or with counters."""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.codegen.procedure.symbols import Counter, Number, counter_operand, number_operand

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
    """

    def __init__(self, text: FunctionText, address: str, shape: tuple[int, ...]) -> None:
        self.text = text
        self.address = address
        self.shape = shape

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
        return Memory(self.text, self.address, shape)

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
            address = self.text.assign(f"getelementptr double, ptr {self.address}, i64 {counter_operand(first)}")
            return Memory(self.text, address, shape)
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
        first: Any = 0
        for axis, entry in enumerate(indices):
            first = first + entry * prod(self.shape[axis + 1 :])
        rest = self.shape[len(indices) :]
        return (first, rest) if rest else first

    def _load(self, position: int | Counter) -> Number:
        return Number(self.text, self.text.assign(f"load double, ptr {self._address(position)}, align 8"))

    def _store(self, position: int | Counter, value: object) -> None:
        address = self._address(position)
        self.text.append(f"store double {number_operand(value)}, ptr {address}, align 8")

    def _address(self, position: int | Counter) -> str:
        if isinstance(position, int) and position == 0:
            return self.address
        return self.text.assign(f"getelementptr double, ptr {self.address}, i64 {counter_operand(position)}")

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
