"""Calls of procedures that compute several samples at once, each in a lane of vectors.

A branch runs if any lane takes it, and a loop while any lane is in it. A mask has the lanes for which statements run:
the others keep the values that they have. So each lane has the results that it has alone.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from robot_dynamics.codegen.procedure.frames import Frame, Loop, number_of_loop
from robot_dynamics.codegen.procedure.slots import ScalarSlot, make_slot, merge, store_together
from robot_dynamics.codegen.procedure.statements import assigned_names
from robot_dynamics.codegen.procedure.symbols import Condition, Counter, common_lanes, condition_operand

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.slots import Slot

FRESH: frozenset[str] = frozenset()
"""No addresses: for slots that are stored alone."""


@dataclass
class LaneLoop(Loop):
    """A Loop that lanes leave one by one.

    Attributes
    ----------
    remaining : ScalarSlot
        The lanes that are in the loop.
    active : ScalarSlot
        Those of them that have not left the body in the present round.
    depth : int
        Number of masked branches around the loop.
    """

    remaining: ScalarSlot
    active: ScalarSlot
    depth: int


class LaneFrame(Frame):
    """A call of a procedure for all lanes."""

    _depth = 0
    """Masked branches around the present statement."""
    _has_left = False
    """Whether the lanes of the present block have left the body of a loop."""

    def _is_ended(self) -> bool:
        return self._has_left or super()._is_ended()

    def _branch(self, statement: ast.If, condition: Condition) -> None:
        if condition.lanes == 1 and not _leaves_loop([*statement.body, *statement.orelse]):
            super()._branch(statement, condition)
            return
        text = self._text
        outer = text.mask
        is_computed = Condition(text, condition.widened(text.lanes))
        names = assigned_names([*statement.body, *statement.orelse])
        before = dict(self._values)
        then = self._run_masked(statement.body, is_computed, outer, before, names)
        otherwise: dict[str, Any] | None = before
        if statement.orelse:
            otherwise = self._run_masked(statement.orelse, ~is_computed, outer, before, names)
        text.mask = outer
        self._has_left = then is None and otherwise is None
        if then is None or otherwise is None:
            remaining = otherwise if then is None else then
            self._values = dict(before)
            if remaining is not None:
                self._values = {name: value for name, value in before.items() if name not in names}
                self._values.update({name: remaining[name] for name in names if name in remaining})
        else:
            self._values = {name: value for name, value in before.items() if name not in names}
            for name in names:
                if name in then and name in otherwise:
                    self._values[name] = _merged(name, is_computed, then[name], otherwise[name])
        if not self._has_left and _leaves_loop([*statement.body, *statement.orelse]):
            self._continue_with_active_lanes()

    def _run_masked(
        self,
        body: Sequence[ast.stmt],
        condition: Condition,
        outer: str | None,
        before: dict[str, Any],
        names: list[str],
    ) -> dict[str, Any] | None:
        """Values of the names after the statements of a branch, which run if any lane takes it.

        None where the branch ends with `break` or `continue`.
        """
        text = self._text
        text.mask = outer
        mask = condition if outer is None else condition & Condition(text, outer)
        begin, end = text.label(), text.label()
        text.branch(_any_lane(mask), begin, end)
        text.begin(begin)
        self._values, self._has_left = dict(before), False
        text.mask = mask.operand
        self._depth += 1
        self._run(body)
        self._depth -= 1
        slots: dict[str, Slot] = {}
        if not self._has_left:
            slots = {name: make_slot(text, self._values[name]) for name in names if name in self._values}
            store_together(slots, self._values)
        text.begin(end)
        return None if self._has_left else {name: slot.load() for name, slot in slots.items()}

    def _continue_with_active_lanes(self) -> None:
        """Compute only the lanes that have not left the body of the loop; leave it if there is none."""
        text = self._text
        loop = self._loops[-1]
        assert isinstance(loop, LaneLoop)
        mask = Condition(text, loop.active.load().operand)
        if text.mask is not None:
            mask &= Condition(text, text.mask)
        text.mask = mask.operand
        if self._depth == loop.depth:
            proceed = text.label()
            text.branch(_any_lane(mask), proceed, loop.next_label)
            text.begin(proceed)

    def _run_counted_loop(self, statement: ast.For, first: Any, end: Any, stride: int) -> None:
        if common_lanes(end) == 1 and not _leaves_loop(statement.body):
            super()._run_counted_loop(statement, first, end, stride)
            return
        text = self._text
        outer = text.mask
        counter = ScalarSlot(text, Counter, lanes=1)
        counter.prepare(first, FRESH)()
        slots, before = self._begin_loop(statement.body)
        head, body, following, end_label = (text.label() for _ in range(4))
        loop = self._make_loop(slots, following, end_label)
        text.begin(head)
        number = number_of_loop(counter, first, end, stride)
        remaining = loop.remaining.load()
        assert isinstance(remaining, Condition)
        is_within = number < end
        if is_within.lanes == 1:
            proceeds = text.assign(f"and i1 {is_within.operand}, {_any_lane(remaining)}")
        else:
            remaining &= is_within
            loop.remaining.prepare(remaining, FRESH)()
            proceeds = _any_lane(remaining)
        text.branch(proceeds, body, end_label)
        text.begin(body)
        self._values = {**before, **{name: slot.load() for name, slot in slots.items()}}
        self._assign_to(statement.target, number)
        self._run_round(statement.body, loop, remaining)
        text.mask = outer
        text.begin(following)
        counter.prepare(number + stride, FRESH)()
        text.jump(head)
        self._end_loop(slots, before, end_label)
        self._drop(statement.target)

    def _while(self, statement: ast.While) -> None:
        if statement.orelse:
            raise TypeError("a procedure cannot contain `else` of a loop: use a condition")
        text = self._text
        outer = text.mask
        slots, before = self._begin_loop(statement.body)
        head, body, following, end_label = (text.label() for _ in range(4))
        loop = self._make_loop(slots, following, end_label)
        text.begin(head)
        self._values = {**before, **{name: slot.load() for name, slot in slots.items()}}
        remaining = loop.remaining.load()
        assert isinstance(remaining, Condition)
        text.mask = remaining.operand
        remaining &= Condition(text, condition_operand(self._evaluate(statement.test), text.lanes))
        text.mask = outer
        loop.remaining.prepare(remaining, FRESH)()
        text.branch(_any_lane(remaining), body, end_label)
        text.begin(body)
        self._run_round(statement.body, loop, remaining)
        text.mask = outer
        text.begin(following)
        text.jump(head)
        self._end_loop(slots, before, end_label)

    def _make_loop(self, slots: dict[str, Slot], next_label: str, exit_label: str) -> LaneLoop:
        """A loop that the present lanes enter."""
        text = self._text
        remaining, active = ScalarSlot(text, Condition), ScalarSlot(text, Condition)
        remaining.prepare(True if text.mask is None else Condition(text, text.mask), FRESH)()
        return LaneLoop(slots, next_label, exit_label, remaining, active, self._depth)

    def _run_round(self, body: Sequence[ast.stmt], loop: LaneLoop, lanes: Condition) -> None:
        """The statements of a loop, for some lanes."""
        loop.active.prepare(lanes, FRESH)()
        self._text.mask = lanes.operand
        self._run_body(body, loop)
        self._has_left = False

    def _leave_loop(self, statement: ast.stmt) -> None:
        loop = self._loops[-1] if self._loops else None
        if not isinstance(loop, LaneLoop):
            raise TypeError("`break` and `continue` belong into a loop over range(...) or `while`")
        text = self._text
        assert text.mask is not None
        store_together(loop.slots, self._values)
        leaving = Condition(text, text.mask)
        text.mask = None
        for slot in (loop.active, loop.remaining) if isinstance(statement, ast.Break) else (loop.active,):
            lanes = slot.load()
            assert isinstance(lanes, Condition)
            slot.prepare(lanes & ~leaving, FRESH)()
        text.mask = leaving.operand
        self._has_left = True


def _merged(name: str, condition: Condition, chosen: Any, otherwise: Any) -> Any:
    try:
        return merge(condition, chosen, otherwise)
    except TypeError as error:
        raise TypeError(f"{name!r} is assigned in a loop or branch: {error}") from None


def _any_lane(condition: Condition) -> str:
    """Operand of the type i1: whether a condition holds in any lane."""
    text = condition.text
    bits = text.assign(f"bitcast {condition.type} {condition.operand} to i{text.lanes}")
    return text.assign(f"icmp ne i{text.lanes} {bits}, 0")


def _leaves_loop(statements: Sequence[ast.stmt]) -> bool:
    """Whether some statements contain `break` or `continue` of the loop around them."""
    return any(isinstance(node, ast.Break | ast.Continue) for node in _own_statements(statements))


def _own_statements(statements: Sequence[ast.stmt]) -> Iterator[ast.stmt]:
    """All statements but those in loops among them."""
    for statement in statements:
        yield statement
        if isinstance(statement, ast.If):
            yield from _own_statements([*statement.body, *statement.orelse])
