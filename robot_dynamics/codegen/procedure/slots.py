"""Slots: memory for the values of names that change in loops and branches of a procedure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from robot_dynamics.codegen.procedure.memory import Memory
from robot_dynamics.codegen.procedure.symbols import (
    Condition,
    Counter,
    Number,
    condition_operand,
    counter_operand,
    number_operand,
)

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.function_text import FunctionText
    from robot_dynamics.codegen.procedure.symbols import Symbol

Store = Callable[[], None]


class Slot(Protocol):
    """Memory for a value of one kind and shape."""

    def load(self) -> Any:
        """The value, read now."""

    def prepare(self, value: Any, addresses: frozenset[str]) -> Store:
        """Read a value; the function returned stores it. addresses: of all slots that are stored together.

        Raises TypeError where the value has another kind or shape.
        """


class ScalarSlot:
    """Slot of a number, a condition or a counter."""

    def __init__(self, text: FunctionText, kind: type[Symbol]) -> None:
        self._text = text
        self._kind = kind
        self._address = text.allocate(1)

    def load(self) -> Symbol:
        return self._kind(self._text, self._text.assign(f"load {IR_TYPES[self._kind]}, ptr {self._address}, align 8"))

    def prepare(self, value: Any, addresses: frozenset[str]) -> Store:
        operand = OPERANDS[self._kind](value)
        return lambda: self._text.append(f"store {IR_TYPES[self._kind]} {operand}, ptr {self._address}, align 8")


class ArraySlot:
    """Slot of an array."""

    def __init__(self, text: FunctionText, shape: tuple[int, ...]) -> None:
        self._memory = Memory(text, text.allocate(int(np.prod(shape))), shape)

    def load(self) -> Memory:
        return self._memory

    @property
    def address(self) -> str:
        """The address of the memory."""
        return self._memory.address

    def prepare(self, value: Any, addresses: frozenset[str]) -> Store:
        shape = np.shape(value) if not isinstance(value, Memory) else value.shape
        if shape != self._memory.shape:
            raise TypeError(f"its shape changes from {self._memory.shape} to {shape}")
        if not isinstance(value, Memory):
            return lambda: self._memory.copy_from(value)
        if value.address == self.address:
            return lambda: None
        if value.address in addresses:
            entries = value.values()
            return lambda: self._memory.copy_from(entries)
        return lambda: copy_memory(value, self._memory)


class TupleSlot:
    """Slots of the entries of a tuple."""

    def __init__(self, kind: type[tuple[Any, ...]], slots: Sequence[Slot]) -> None:
        self._kind = kind
        self.slots = slots

    def load(self) -> Any:
        values = [slot.load() for slot in self.slots]
        return self._kind(*values) if hasattr(self._kind, "_fields") else tuple(values)

    def prepare(self, value: Any, addresses: frozenset[str]) -> Store:
        if type(value) is not self._kind or len(value) != len(self.slots):
            raise TypeError(f"it changes from a {self._kind.__name__} of {len(self.slots)} to {type(value).__name__}")
        stores = [slot.prepare(entry, addresses) for slot, entry in zip(self.slots, value, strict=True)]

        def store() -> None:
            for store_entry in stores:
                store_entry()

        return store


class ConstantSlot:
    """A value that is the same object in all branches."""

    def __init__(self, value: object) -> None:
        self._value = value

    def load(self) -> object:
        return self._value

    def prepare(self, value: Any, addresses: frozenset[str]) -> Store:
        if value is not self._value:
            raise TypeError(f"{type(value).__name__} cannot change while the procedure runs")
        return lambda: None


IR_TYPES: dict[type[Symbol], str] = {Number: "double", Condition: "i1", Counter: "i64"}
OPERANDS: dict[type[Symbol], Callable[[Any], str]] = {
    Number: number_operand,
    Condition: condition_operand,
    Counter: counter_operand,
}


def make_slot(text: FunctionText, value: Any) -> Slot:
    """A slot for a value and all others of its kind and shape."""
    if isinstance(value, Memory | np.ndarray) and np.shape(value) != ():
        return ArraySlot(text, tuple(value.shape))
    if isinstance(value, tuple):
        return TupleSlot(type(value), [make_slot(text, entry) for entry in value])
    if isinstance(value, Condition | bool | np.bool_):
        return ScalarSlot(text, Condition)
    if isinstance(value, Counter | int | np.integer):
        return ScalarSlot(text, Counter)
    if isinstance(value, Number | float | np.floating):
        return ScalarSlot(text, Number)
    return ConstantSlot(value)


def store_together(slots: Mapping[str, Slot], values: Mapping[str, Any]) -> None:
    """Store the values of some names: all are read before one is written."""
    addresses = frozenset(_addresses(slots.values()))
    stores = []
    for name, slot in slots.items():
        try:
            stores.append(slot.prepare(values[name], addresses))
        except TypeError as error:
            raise TypeError(f"{name!r} is assigned in a loop or branch: {error}") from None
    for store in stores:
        store()


def copy_memory(source: Memory, target: Memory) -> None:
    """Copy all entries."""
    arguments = f"ptr {target.address}, ptr {source.address}, i64 {8 * source.size}, i1 false"
    source.text.append(f"call void @llvm.memcpy.p0.p0.i64({arguments})")


def _addresses(slots: Any) -> list[str]:
    addresses: list[str] = []
    for slot in slots:
        if isinstance(slot, ArraySlot):
            addresses.append(slot.address)
        elif isinstance(slot, TupleSlot):
            addresses += _addresses(slot.slots)
    return addresses
