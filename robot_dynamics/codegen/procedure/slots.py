"""Slots: memory for the values of names that change in loops and branches of a procedure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from robot_dynamics.codegen.procedure.ir_types import ir_type
from robot_dynamics.codegen.procedure.memory import Memory
from robot_dynamics.codegen.procedure.symbols import OPERANDS, Condition, Counter, Number, Symbol, choose, counter_range

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.function_text import FunctionText

Store = Callable[[], None]

MAX_COPIED_BY_ENTRIES = 64
"""Entries of an array up to which each is loaded and stored."""


class Slot(Protocol):
    """Memory for a value of one kind and shape."""

    def load(self) -> Any:
        """The value, read now."""

    def prepare(self, value: Any, addresses: frozenset[str]) -> Store:
        """Read a value; the function returned stores it. addresses: of all slots that are stored together.

        Raises TypeError where the value has another kind or shape.
        """


class ScalarSlot:
    """Slot of a number, a condition or a counter; `lanes` as in Symbol."""

    def __init__(self, text: FunctionText, kind: type[Symbol], lanes: int | None = None) -> None:
        self._text = text
        self._kind = kind
        self._lanes = text.lanes if lanes is None else lanes
        self._type = ir_type(kind.ELEMENT, self._lanes)
        self._address = text.allocate(1)
        self._mask = text.mask
        self._range = text.index_checks.new_name() if kind is Counter else None

    def load(self) -> Symbol:
        operand = self._text.assign(f"load {self._type}, ptr {self._address}, align 8")
        if self._range is not None:
            return Counter(self._text, operand, self._lanes, self._range)
        return self._kind(self._text, operand, self._lanes)

    def prepare(self, value: Any, addresses: frozenset[str]) -> Store:
        operand = OPERANDS[self._kind](value, self._lanes)
        if self._range is not None:
            self._range.add(counter_range(value))
        mask = self._text.mask
        if mask != self._mask and mask is not None and self._lanes > 1:
            operand = choose(Condition(self._text, mask), value, self.load(), self._kind).operand
        return lambda: self._text.append(f"store {self._type} {operand}, ptr {self._address}, align 8")


class ArraySlot:
    """Slot of an array."""

    def __init__(self, text: FunctionText, shape: tuple[int, ...]) -> None:
        self._memory = Memory(text, text.allocate(int(np.prod(shape))), shape, text.mask)

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
        if name not in values:
            raise TypeError(
                f"{name!r} has a value before a loop or branch, and may have none after it: take another name in it"
            )
        try:
            stores.append(slot.prepare(values[name], addresses))
        except TypeError as error:
            raise TypeError(f"{name!r} is assigned in a loop or branch: {error}") from None
    for store in stores:
        store()


def copy_memory(source: Memory, target: Memory) -> None:
    """Copy all entries."""
    text = source.text
    if not target.is_partly_stored:
        arguments = f"ptr {target.address}, ptr {source.address}, i64 {8 * text.lanes * source.size}, i1 false"
        text.append(f"call void @llvm.memcpy.p0.p0.i64({arguments})")
    elif source.size <= MAX_COPIED_BY_ENTRIES:
        target.copy_from(source)
    else:
        assert text.mask is not None
        _copy_lanes(source, target, text.mask)


def _copy_lanes(source: Memory, target: Memory, mask: str) -> None:
    """Copy all entries of some lanes, in a loop."""
    mask_type = ir_type("i1", source.text.lanes)
    arguments = f"ptr {source.address}, ptr {target.address}, {mask_type} {mask}, i64 {source.size}"
    source.text.append(f"call void @copy_lanes({arguments})")


def merge(condition: Condition, chosen: Any, otherwise: Any) -> Any:
    """The value of a name after a branch that some lanes take: `chosen` in these lanes, else `otherwise`.

    The memory of `chosen` may be used for the result. Raises TypeError where the values have not one kind and shape.
    """
    if isinstance(chosen, Memory) and chosen.size > MAX_COPIED_BY_ENTRIES and isinstance(otherwise, Memory):
        if chosen.shape != otherwise.shape:
            raise TypeError(f"its shape changes from {chosen.shape} to {otherwise.shape}")
        _copy_lanes(otherwise, chosen, (~condition).operand)
        return chosen
    if isinstance(chosen, Memory | np.ndarray) and np.shape(chosen) != ():
        entries, others = np.asarray(chosen), np.asarray(otherwise)
        if entries.shape != others.shape:
            raise TypeError(f"its shape changes from {entries.shape} to {others.shape}")
        merged = np.empty(entries.shape, dtype=object)
        for index in np.ndindex(entries.shape):
            merged[index] = choose(condition, entries[index], others[index])
        return merged
    if isinstance(chosen, tuple):
        if type(otherwise) is not type(chosen) or len(chosen) != len(otherwise):
            raise TypeError(f"it changes from a {type(chosen).__name__} to {type(otherwise).__name__}")
        values = [merge(condition, *pair) for pair in zip(chosen, otherwise, strict=True)]
        return type(chosen)(*values) if hasattr(type(chosen), "_fields") else tuple(values)
    if isinstance(chosen, Symbol):
        return choose(condition, chosen, otherwise, type(chosen))
    if chosen is not otherwise:
        raise TypeError(f"{type(chosen).__name__} cannot change while the procedure runs")
    return chosen


def _addresses(slots: Any) -> list[str]:
    addresses: list[str] = []
    for slot in slots:
        if isinstance(slot, ArraySlot):
            addresses.append(slot.address)
        elif isinstance(slot, TupleSlot):
            addresses += _addresses(slot.slots)
    return addresses
