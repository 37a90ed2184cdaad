"""Staging of procedures: Python functions to LLVM IR, statement by statement.

Expressions are evaluated by Python, with symbols for all that depends on the arguments. Branches and loops whose
conditions are symbols become blocks of the function; those whose conditions are known are decided here.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.codegen.procedure.memory import Memory, as_values
from robot_dynamics.codegen.procedure.slots import copy_memory, make_slot, store_together
from robot_dynamics.codegen.procedure.symbols import (
    Condition,
    Counter,
    Number,
    Symbol,
    condition_operand,
    counter_operand,
    number_operand,
)
from robot_dynamics.procedures import active_stage

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.function_text import FunctionText
    from robot_dynamics.codegen.procedure.kernels import Kernel
    from robot_dynamics.codegen.procedure.slots import Slot


class ProcedureStage:
    """A procedure while it is staged, with all procedures and kernels that it calls.

    Attributes
    ----------
    text : FunctionText
    kernels : dict of str to Kernel
        The kernels that are called, by the name of their function.
    """

    def __init__(self, text: FunctionText) -> None:
        self.text = text
        self.kernels: dict[str, Kernel] = {}

    def stage(self, function: Callable[..., Any], arguments: Sequence[Any]) -> Any:
        """The result of a procedure for symbols."""
        token = active_stage.set(self)
        try:
            return function(*arguments)
        finally:
            active_stage.reset(token)

    def call(self, function: Callable[..., Any], arguments: Sequence[Any], options: dict[str, Any]) -> Any:
        """The result of a procedure; its statements are appended to the text."""
        bound = inspect.signature(function).bind(*arguments, **options)
        bound.apply_defaults()
        return Frame(self, function, dict(bound.arguments)).run()

    def call_kernel(self, kernel: Kernel, arguments: Sequence[Any]) -> Any:
        """The outputs of a kernel, as Memory."""
        self.kernels[kernel.name] = kernel
        interface = kernel.interface
        memories = [
            argument if isinstance(argument, Memory) else self._in_memory(argument, size)
            for argument, size in zip(arguments, interface.inputs.values(), strict=True)
        ]
        for memory, (name, size) in zip(memories, interface.inputs.items(), strict=True):
            if memory.size != size:
                raise TypeError(f"{kernel.name}: {name} has {size} entries, not {memory.size}")
        outputs = [self.zeros(shape, is_cleared=False) for _, shape in interface.outputs]
        table = self.text.allocate(len(memories) + len(outputs))
        for number, memory in enumerate([*memories, *outputs]):
            entry = self.text.assign(f"getelementptr ptr, ptr {table}, i64 {number}")
            self.text.append(f"store ptr {memory.address}, ptr {entry}, align 8")
        self.text.append(f"call void @{kernel.name}(ptr {table})")
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def _in_memory(self, values: Any, size: int) -> Memory:
        memory = self.zeros((size,), is_cleared=False)
        memory.copy_from(values)
        return memory

    def zeros(self, shape: tuple[int, ...], is_cleared: bool = True) -> Memory:
        """An array in memory; its entries are undefined if it is not cleared."""
        memory = Memory(self.text, self.text.allocate(int(np.prod(shape))), tuple(shape))
        if is_cleared:
            self.text.append(f"call void @llvm.memset.p0.i64(ptr {memory.address}, i8 0, i64 {8 * memory.size}, i1 0)")
        return memory

    def copy(self, values: Any) -> Memory:
        """A copy of an array in memory."""
        memory = self.zeros(tuple(values.shape), is_cleared=False)
        if isinstance(values, Memory):
            copy_memory(values, memory)
        else:
            memory.copy_from(values)
        return memory

    def select(self, condition: Any, chosen: Any, otherwise: Any) -> Any:
        """Numbers or arrays of them."""
        conditions, first, second = np.broadcast_arrays(*map(as_objects, (condition, chosen, otherwise)))
        selected = np.empty(conditions.shape, dtype=object)
        for index in np.ndindex(conditions.shape):
            selected[index] = self._select(conditions[index], first[index], second[index])
        return selected[()]

    def _select(self, condition: Any, chosen: Any, otherwise: Any) -> Any:
        if not isinstance(condition, Condition):
            return chosen if condition else otherwise
        if isinstance(chosen, Counter | int) and isinstance(otherwise, Counter | int):
            operands = f"i64 {counter_operand(chosen)}, i64 {counter_operand(otherwise)}"
            return Counter(self.text, self.text.assign(f"select i1 {condition.operand}, {operands}"))
        operands = f"double {number_operand(chosen)}, double {number_operand(otherwise)}"
        return Number(self.text, self.text.assign(f"select i1 {condition.operand}, {operands}"))

    def largest(self, values: Any) -> Any:
        """The largest entry, nan if one is nan."""
        entries = list(np.ravel(as_objects(values)))
        if not any(isinstance(entry, Symbol) for entry in entries):
            return max(entries, default=0.0)
        return reduce(self._larger, entries)

    def _larger(self, a: Any, b: Any) -> Number:
        operands = f"double {number_operand(a)}, double {number_operand(b)}"
        return Number(self.text, self.text.assign(f"call double @llvm.maximum.f64({operands})"))

    def magnitude(self, value: Any) -> Any:
        """Absolute values."""
        return np.abs(as_values(value))

    def rounded(self, value: Any) -> Any:
        """Nearest integers."""
        return np.rint(as_values(value))


def as_objects(value: Any) -> Any:
    """A value as an array of objects."""
    values = as_values(value)
    if isinstance(values, np.ndarray):
        return values.astype(object)
    entry = np.empty((), dtype=object)
    entry[()] = values
    return entry


@dataclass
class Loop:
    """The loop whose body is being staged: the slots of its names, and where `continue` and `break` lead."""

    slots: Mapping[str, Slot]
    next_label: str
    exit_label: str


class Frame:
    """A call of a procedure: its names and their values."""

    def __init__(self, stage: ProcedureStage, function: Callable[..., Any], values: dict[str, Any]) -> None:
        self._stage = stage
        self._text = stage.text
        self._function = function
        closure = inspect.getclosurevars(function)
        self._globals = {**function.__globals__, **closure.nonlocals, "__builtins__": builtins}
        self._values = values
        self._loops: list[Loop | None] = []  # None for a loop that is unrolled

    def run(self) -> Any:
        """The result of the procedure."""
        *statements, last = _parse(self._function)
        self._run(statements)
        if isinstance(last, ast.Return):
            return None if last.value is None else self._evaluate(last.value)
        self._run([last])
        return None

    def _run(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            if self._text.is_ended:
                return
            try:
                handler = HANDLERS[type(statement)]
            except KeyError:
                raise TypeError(
                    f"a procedure cannot contain {type(statement).__name__} in line {statement.lineno} "
                    f"of {self._function.__qualname__}"
                ) from None
            handler(self, statement)

    def _evaluate(self, node: ast.expr) -> Any:
        if isinstance(node, ast.BoolOp):
            is_all = isinstance(node.op, ast.And)
            return reduce(
                lambda left, right: self._combine(is_all, left, right), node.values[1:], self._evaluate(node.values[0])
            )
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            value = self._evaluate(node.operand)
            return ~value if isinstance(value, Condition) else not value
        code = compile(ast.fix_missing_locations(ast.Expression(node)), self._function.__code__.co_filename, "eval")
        return eval(code, {**self._globals, **self._values})

    def _combine(self, is_all: bool, left: Any, node: ast.expr) -> Any:
        """`left and node`, or `left or node`."""
        if not isinstance(left, Condition):
            return self._evaluate(node) if bool(left) == is_all else left
        right = self._evaluate(node)
        return left & right if is_all else left | right

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
        text = self._text
        names = _assigned_names([*statement.body, *statement.orelse])
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
        if _is_range(statement.iter):
            self._counted_loop(statement)
            return
        self._loops.append(None)
        for value in self._evaluate(statement.iter):
            self._assign_to(statement.target, value)
            self._run(statement.body)
        self._loops.pop()

    def _counted_loop(self, statement: ast.For) -> None:
        assert isinstance(statement.iter, ast.Call)
        limits = [self._evaluate(argument) for argument in statement.iter.args]
        first, end = (0, limits[0]) if len(limits) == 1 else limits[:2]
        stride = limits[2] if len(limits) == 3 else 1
        if not isinstance(stride, int) or stride <= 0:
            raise TypeError("the step of a loop must be a positive constant")
        slots, before = self._begin_loop(statement.body)
        counter = make_slot(self._text, 0)
        counter.prepare(first, frozenset())()
        text = self._text
        head, body, following, end_label = (text.label() for _ in range(4))
        text.begin(head)
        number = counter.load()
        text.branch(condition_operand(number < end), body, end_label)
        text.begin(body)
        self._values = {**before, **{name: slot.load() for name, slot in slots.items()}}
        self._assign_to(statement.target, number)
        self._run_body(statement.body, Loop(slots, following, end_label))
        text.begin(following)
        counter.prepare(counter.load() + stride, frozenset())()
        text.jump(head)
        self._end_loop(slots, before, end_label)

    def _while(self, statement: ast.While) -> None:
        if statement.orelse:
            raise TypeError("a procedure cannot contain `else` of a loop: use a condition")
        slots, before = self._begin_loop(statement.body)
        text = self._text
        head, body, end_label = (text.label() for _ in range(3))
        text.begin(head)
        self._values = {**before, **{name: slot.load() for name, slot in slots.items()}}
        condition = self._evaluate(statement.test)
        text.branch(condition_operand(condition), body, end_label)
        text.begin(body)
        self._run_body(statement.body, Loop(slots, head, end_label))
        text.jump(head)
        self._end_loop(slots, before, end_label)

    def _begin_loop(self, body: Sequence[ast.stmt]) -> tuple[dict[str, Slot], dict[str, Any]]:
        """Slots for the names that the body changes, with their values before the loop; and all values before it."""
        names = [name for name in _assigned_names(body) if name in self._values]
        slots = {name: make_slot(self._text, self._values[name]) for name in names}
        store_together(slots, self._values)
        return slots, dict(self._values)

    def _run_body(self, body: Sequence[ast.stmt], loop: Loop) -> None:
        self._loops.append(loop)
        self._run(body)
        self._loops.pop()
        if not self._text.is_ended:
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
        module = ast.Module([statement], type_ignores=[])
        namespace = {**self._globals, **self._values}
        exec(compile(module, self._function.__code__.co_filename, "exec"), namespace)
        self._values[statement.name] = namespace[statement.name]

    def _pass(self, statement: ast.stmt) -> None:
        """Nothing."""


HANDLERS: dict[type[ast.stmt], Callable[[Frame, Any], None]] = {
    ast.Assign: Frame._assign,
    ast.AnnAssign: Frame._annotated_assign,
    ast.AugAssign: Frame._augmented_assign,
    ast.If: Frame._if,
    ast.For: Frame._for,
    ast.While: Frame._while,
    ast.Break: Frame._leave_loop,
    ast.Continue: Frame._leave_loop,
    ast.Expr: Frame._expression,
    ast.FunctionDef: Frame._define,
    ast.Pass: Frame._pass,
}


@cache
def _parse(function: Callable[..., Any]) -> list[ast.stmt]:
    """The statements of a function."""
    definition = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(definition, ast.FunctionDef)
    return definition.body


def _is_range(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range"


def _assigned_names(statements: Sequence[ast.stmt]) -> list[str]:
    """The names that statements assign, each once."""
    nodes = [node for statement in statements for node in ast.walk(statement)]
    return list(
        dict.fromkeys(node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))
    )
