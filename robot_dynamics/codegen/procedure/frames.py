"""Calls of procedures while they are staged: Python functions to LLVM IR, statement by statement.

Expressions are evaluated by Python, with symbols for all that depends on the arguments. Branches and loops whose
conditions are symbols become blocks of the function; those whose conditions are known are decided here.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.codegen.procedure.counter_ranges import numbers_of_loop
from robot_dynamics.codegen.procedure.expressions import Expressions
from robot_dynamics.codegen.procedure.memory import Memory, as_values
from robot_dynamics.codegen.procedure.slots import ScalarSlot, make_slot, store_together
from robot_dynamics.codegen.procedure.statements import assigned_names, is_range
from robot_dynamics.codegen.procedure.symbols import Condition, Counter, condition_operand, counter_range

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.slots import Slot
    from robot_dynamics.codegen.procedure.staging import ProcedureStage


@dataclass
class Loop:
    """The loop whose body is being staged: the slots of its names, and where `continue` and `break` lead."""

    slots: Mapping[str, Slot]
    next_label: str
    exit_label: str


class Frame(Expressions):
    """A call of a procedure: its names and their values."""

    def __init__(self, stage: ProcedureStage, function: Callable[..., Any], values: dict[str, Any]) -> None:
        super().__init__(stage.text, function, values)
        self._loops: list[Loop | None] = []  # None for a loop that is unrolled

    def run(self) -> Any:
        """The result of the procedure."""
        *statements, last = self._source.statements
        self._run(statements)
        if isinstance(last, ast.Return):
            with self._located(last):
                return None if last.value is None else self._evaluate(last.value)
        self._run([last])
        return None

    def _run(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            if self._is_ended():
                return
            with self._located(statement):
                if type(statement) not in HANDLERS:
                    raise TypeError(f"a procedure cannot contain {type(statement).__name__} here")
                getattr(self, HANDLERS[type(statement)])(statement)

    def _is_ended(self) -> bool:
        """Whether no statement that follows in the same block is reached."""
        return self._text.is_ended

    def _assign(self, statement: ast.Assign) -> None:
        value = self._evaluate(statement.value)
        for target in statement.targets:
            self._assign_to(target, value)

    def _annotated_assign(self, statement: ast.AnnAssign) -> None:
        if statement.value is not None:
            self._assign_to(statement.target, self._evaluate(statement.value))

    def _augmented_assign(self, statement: ast.AugAssign) -> None:
        target = statement.target
        current = ast.parse(ast.unparse(target), mode="eval").body
        value = self._evaluate(ast.BinOp(current, statement.op, statement.value))
        if isinstance(target, ast.Name) and np.ndim(value):
            raise TypeError(
                f"{target.id!r} is an array: write x = x + y, which does not change the array of the caller"
            )
        self._assign_to(target, value)

    def _assign_to(self, target: ast.expr, value: Any) -> None:
        if isinstance(target, ast.Name):
            self._values[target.id] = value
        elif isinstance(target, ast.Tuple):
            entries = list(as_values(value))
            for entry_target, entry in zip(target.elts, entries, strict=True):
                self._assign_to(entry_target, entry)
        elif isinstance(target, ast.Subscript):
            container = self._evaluate(target.value)
            if not isinstance(container, Memory):
                raise TypeError(f"{ast.unparse(target.value)} is not from `zeros`: its entries cannot be assigned")
            index = ast.Subscript(ast.Name("__slice__", ast.Load()), target.slice, ast.Load())
            self._values["__slice__"] = np.s_
            container[self._evaluate(index)] = value
        else:
            raise TypeError(f"a procedure cannot assign to {ast.unparse(target)}")

    def _if(self, statement: ast.If) -> None:
        condition = self._evaluate(statement.test)
        if not isinstance(condition, Condition):
            self._run(statement.body if condition else statement.orelse)
            return
        self._branch(statement, condition)

    def _branch(self, statement: ast.If, condition: Condition) -> None:
        """One of the branches of `if`, as a condition says when the code runs."""
        text = self._text
        names = assigned_names([*statement.body, *statement.orelse])
        before = dict(self._values)
        then, otherwise, merge = text.label(), text.label(), text.label()
        text.branch(condition.operand, then, otherwise)
        text.begin(then)
        self._run(statement.body)
        then_values, then_ended = self._values, text.is_ended
        slots: dict[str, Slot] = {}
        if not then_ended:
            slots = {name: make_slot(text, then_values[name]) for name in names if name in then_values}
            store_together(slots, then_values)
        text.jump(merge)
        self._values = dict(before)
        text.begin(otherwise)
        self._run(statement.orelse)
        otherwise_ended = text.is_ended
        if then_ended:
            if not otherwise_ended:
                text.begin(merge)
            return
        if otherwise_ended:
            text.begin(merge)
            self._values = then_values
            return
        slots = {name: slot for name, slot in slots.items() if name in self._values}
        store_together(slots, self._values)
        text.begin(merge)
        self._values = {name: value for name, value in before.items() if name not in names}
        self._values.update({name: slot.load() for name, slot in slots.items()})

    def _for(self, statement: ast.For) -> None:
        if statement.orelse:
            raise TypeError("a procedure cannot contain `else` of a loop: use a condition")
        if is_range(statement.iter):
            self._counted_loop(statement)
            return
        self._loops.append(None)
        for value in self._evaluate(statement.iter):
            self._assign_to(statement.target, value)
            self._run(statement.body)
        self._loops.pop()

    def _counted_loop(self, statement: ast.For) -> None:
        assert isinstance(statement.iter, ast.Call)
        self._run_counted_loop(statement, *self._evaluate_range(statement.iter))

    def _run_counted_loop(self, statement: ast.For, first: Any, end: Any, stride: int) -> None:
        slots, before = self._begin_loop(statement.body)
        counter = ScalarSlot(self._text, Counter, lanes=1)
        counter.prepare(first, frozenset())()
        text = self._text
        head, body, following, end_label = (text.label() for _ in range(4))
        text.begin(head)
        number = number_of_loop(counter, first, end, stride)
        text.branch(condition_operand(number < end, 1), body, end_label)
        text.begin(body)
        self._values = {**before, **{name: slot.load() for name, slot in slots.items()}}
        self._assign_to(statement.target, number)
        self._run_body(statement.body, Loop(slots, following, end_label))
        text.begin(following)
        counter.prepare(number + stride, frozenset())()
        text.jump(head)
        self._end_loop(slots, before, end_label)
        self._drop(statement.target)

    def _drop(self, target: ast.expr) -> None:
        """Forget the number of a loop, which is not known after it."""
        for name in assigned_names([target]):
            self._values.pop(name, None)

    def _evaluate_range(self, node: ast.Call) -> tuple[Any, Any, int]:
        """First number, end and step of range(...)."""
        limits = [self._evaluate(argument) for argument in node.args]
        first, end = (0, limits[0]) if len(limits) == 1 else limits[:2]
        stride = limits[2] if len(limits) == 3 else 1
        if not isinstance(stride, int) or stride <= 0:
            raise TypeError("the step of a loop must be a positive constant")
        return first, end, stride

    def _while(self, statement: ast.While) -> None:
        if statement.orelse:
            raise TypeError("a procedure cannot contain `else` of a loop: use a condition")
        slots, before = self._begin_loop(statement.body)
        text = self._text
        head, body, end_label = (text.label() for _ in range(3))
        text.begin(head)
        self._values = {**before, **{name: slot.load() for name, slot in slots.items()}}
        condition = self._evaluate(statement.test)
        text.branch(condition_operand(condition, 1), body, end_label)
        text.begin(body)
        self._run_body(statement.body, Loop(slots, head, end_label))
        text.jump(head)
        self._end_loop(slots, before, end_label)

    def _begin_loop(self, body: Sequence[ast.stmt]) -> tuple[dict[str, Slot], dict[str, Any]]:
        """Slots for the names that the body changes, with their values before the loop; and all values before it."""
        names = [name for name in assigned_names(body) if name in self._values]
        slots = {name: make_slot(self._text, self._values[name]) for name in names}
        store_together(slots, self._values)
        return slots, dict(self._values)

    def _run_body(self, body: Sequence[ast.stmt], loop: Loop) -> None:
        self._loops.append(loop)
        self._run(body)
        self._loops.pop()
        if not self._is_ended():
            store_together(loop.slots, self._values)

    def _end_loop(self, slots: Mapping[str, Slot], before: Mapping[str, Any], label: str) -> None:
        self._text.begin(label)
        self._values = {**before, **{name: slot.load() for name, slot in slots.items()}}

    def _leave_loop(self, statement: ast.stmt) -> None:
        loop = self._loops[-1] if self._loops else None
        if loop is None:
            raise TypeError("`break` and `continue` belong into a loop over range(...) or `while`")
        store_together(loop.slots, self._values)
        self._text.jump(loop.exit_label if isinstance(statement, ast.Break) else loop.next_label)

    def _expression(self, statement: ast.Expr) -> None:
        if not isinstance(statement.value, ast.Constant):
            self._evaluate(statement.value)

    def _define(self, statement: ast.FunctionDef) -> None:
        """A function inside the procedure: without branches on symbols, with the values that names have now."""
        self._require_values(statement)
        module = ast.Module([statement], type_ignores=[])
        namespace = {**self._globals, **self._values}
        exec(compile(module, self._function.__code__.co_filename, "exec"), namespace)
        self._values[statement.name] = namespace[statement.name]

    def _pass(self, statement: ast.stmt) -> None:
        """Nothing."""


HANDLERS: dict[type[ast.stmt], str] = {
    ast.Assign: "_assign",
    ast.AnnAssign: "_annotated_assign",
    ast.AugAssign: "_augmented_assign",
    ast.If: "_if",
    ast.For: "_for",
    ast.While: "_while",
    ast.Break: "_leave_loop",
    ast.Continue: "_leave_loop",
    ast.Expr: "_expression",
    ast.FunctionDef: "_define",
    ast.Pass: "_pass",
}


def number_of_loop(counter: ScalarSlot, first: Any, end: Any, stride: int) -> Counter:
    """The number of a loop over range(first, end, stride), read now."""
    number = counter.load()
    assert isinstance(number, Counter)
    number.range = numbers_of_loop(counter_range(first), counter_range(end), stride)
    return number
