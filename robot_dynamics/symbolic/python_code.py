"""Programs as Python: a module to read that needs nothing but `math`, and functions to call, for one sample or many.

Everywhere floats behave as in compiled code: the sine of an infinity is NaN, and division by zero gives an infinity.
"""

import builtins
import functools
import keyword
import math
import operator
import textwrap
from collections import Counter

import numpy as np

from robot_dynamics.errors import QuestionError
from robot_dynamics.symbolic.code_text import (
    FUNCTIONS,
    INFIX,
    Names,
    Variables,
    decimal,
    expression,
    harmless,
    input_comment,
    joints_comment,
    operations_used,
    output_comment,
    settled_nodes,
    signed,
)
from robot_dynamics.symbolic.program import constants
from robot_dynamics.symbolic.scalar import COSINE, DIVIDE, INPUT, PARAMETER, SIGN, SINE, SQUARE_ROOT

HELPERS = {
    SINE: '''
def sin(x):
    """The sine, NaN of an infinity."""
    return math.sin(x) if math.isfinite(x) else math.nan
''',
    COSINE: '''
def cos(x):
    """The cosine, NaN of an infinity."""
    return math.cos(x) if math.isfinite(x) else math.nan
''',
    SQUARE_ROOT: '''
def sqrt(x):
    """The square root, NaN of a negative number."""
    return math.sqrt(x) if x >= 0 else math.nan
''',
    SIGN: '''
def sign(x):
    """1, -1 or 0; NaN of NaN."""
    return 1.0 if x > 0 else -1.0 if x < 0 else x + 0.0
''',
    DIVIDE: '''
def divide(x, y):
    """x / y, by zero too."""
    if y == 0:
        return math.nan if x == 0 or x != x else math.copysign(math.inf, x) * math.copysign(1.0, y)
    return x / y
''',
}
RESERVED = {*keyword.kwlist, *keyword.softkwlist, *dir(builtins), *FUNCTIONS.values()}
RESERVED |= {"divide", "math", "setup", "settled", "elsewhere", "inf", "nan"}
SIGN_WITHIN = "1.0 if (x_ := {}) > 0 else -1.0 if x_ < 0 else x_ + 0.0"
WIDTH = 110
LARGEST_EXPRESSION = 12  # operations that functions compute in one line
BLOCK = 2048  # samples that go through a program together, so that what is alive stays in the cache


def python_source(program, joint_names=()):
    """The text of a module with a function <model>(q, qd, ...) that takes sequences and returns a list of floats.

    An output with more than one axis is given row by row; several outputs are a tuple of lists. Where the program has
    parameters, the module has a function setup(*, <parameter>, ...) too, and what it returns is the last argument of
    the model. joint_names: what the docstring calls the entries of joint vectors.
    """
    variables = Variables(program, Names(RESERVED), _literal)
    used = operations_used(program)
    parts = [_module_docstring(program, variables, joint_names) + "\n\nimport math"]
    parts += [helper for operation, helper in HELPERS.items() if operation in used]
    if program.parameters:
        parts.append(_setup_function(program, variables))
    parts.append(_model_function(program, variables))
    return "\n\n\n".join(part.strip("\n") for part in parts) + "\n"


def python_function(program, parameters=None):
    """A function of the inputs of a program, sequences, that returns what the function of `python_source` does.

    parameters: {name: value} of the program's, settled here once; more may be among them. Raises QuestionError where
    one is missing. Where `math` would raise an error, the function of `python_source` is asked instead.
    """
    settled = _settled(program, parameters)
    packed = _Packed(program, settled, vectorised=False)
    lists = [_list(packed.entries(output)) for output in program.outputs]
    lines = [*packed.lines, f"return {lists[0] if len(lists) == 1 else _tuple(lists)}"]
    if operations_used(program) & {SINE, COSINE, SQUARE_ROOT, DIVIDE}:
        lines = ["try:", *("    " + line for line in lines), "except (ValueError, ZeroDivisionError):"]
        lines.append(f"    return elsewhere()({', '.join(packed.inputs.values())})")
    scope = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt, "inf": math.inf, "nan": math.nan}
    scope["elsewhere"] = functools.cache(functools.partial(_careful_function, program, settled))
    unpacked = [f"{names} = map(float, {given})" for given, names in packed.unpacking(program)]
    return _compiled(program, packed, unpacked + lines, scope)


def python_batch(program, parameters=None):
    """A function of the inputs of a program as arrays (N, size) that returns its outputs as arrays (N, *shape).

    Several outputs are a tuple. The lines of `python_function`, each computed for many samples at once by NumPy.
    Raises QuestionError where a parameter is missing; the function does for arrays of other shapes.
    """
    packed = _Packed(program, _settled(program, parameters), vectorised=True)
    lines = [*packed.lines, f"return {_tuple([_list(packed.entries(output)) for output in program.outputs])}"]
    scope = {"sin": np.sin, "cos": np.cos, "sqrt": np.sqrt, "sign": np.sign, "inf": math.inf, "nan": math.nan}
    unpacked = [f"{names} = {given}" for given, names in packed.unpacking(program)]
    columns = _compiled(program, packed, unpacked + lines, scope)

    def batch(*inputs):
        arrays = _samples(program, inputs)
        count = len(arrays[0]) if arrays else 1
        found = [np.empty((count, len(output.entries))) for output in program.outputs]
        with np.errstate(all="ignore"):
            for start in range(0, count, BLOCK):
                block = slice(start, start + BLOCK)
                computed = columns(*(np.ascontiguousarray(array[block].T) for array in arrays))
                for array, entries in zip(found, computed, strict=True):
                    for place, entry in enumerate(entries):
                        array[block, place] = entry
        shaped = [array.reshape(count, *output.shape) for array, output in zip(found, program.outputs, strict=True)]
        return shaped[0] if len(shaped) == 1 else tuple(shaped)

    batch.__doc__ = _summary(program)
    return batch


_literal = functools.partial(decimal, infinite="math.inf", undefined="math.nan")


def _wrapped(text, indent):
    """A statement with lists in brackets, in lines that are not too long: broken after commas, as Python allows."""
    lines = textwrap.fill(
        text.replace(" ", "\0").replace(",\0", ", "),
        WIDTH,
        initial_indent=indent,
        subsequent_indent=indent + "    ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines.replace("\0", " ")


def _list(texts):
    return f"[{', '.join(texts)}]"


def _tuple(texts):
    return f"({''.join(f'{text}, ' for text in texts)})"


def _summary(program):
    """Sentences about the inputs, the outputs and the cost of a program."""
    lines = ["Inputs, sequences:", *(f"    {input_comment(*pair)}" for pair in program.inputs.items()), "Outputs:"]
    lines += [f"    {output_comment(output)}" for output in program.outputs]
    return "\n".join([*lines, f"Operations of a call: {program.operations}."])


def _module_docstring(program, variables, joint_names):
    title = f'"""{harmless(program.name)}: a model of a robot in straight lines, generated by robot_dynamics.'
    joints = [*joints_comment(joint_names), ""] if joint_names else []
    told = [(leaf.number, leaf.operands[0]) for leaf in program.leaves if leaf.operation == PARAMETER]
    parameters = ["", "Parameters:"] * bool(told)
    parameters += [f"    {variables.nodes[node]}: {harmless(name)}" for node, name in told]
    return "\n".join([title, "", *joints, _summary(program), *parameters, '"""'])


def _setup_function(program, variables):
    nodes = variables.nodes
    keywords = [nodes[leaf.number] for leaf in program.leaves if leaf.operation == PARAMETER]
    lines = [
        _wrapped(f"def setup(*, {', '.join(keywords)}):", ""),
        '    """What depends on parameters alone: the last argument of the model."""',
        *_statement_lines(program.setup, variables),
        _wrapped(f"return {_list([nodes[node] for node in settled_nodes(program)])}", "    "),
    ]
    return "\n".join(lines)


def _model_function(program, variables):
    arguments = list(variables.inputs.values()) + ["settled"] * bool(program.parameters)
    lines = [_wrapped(f"def {variables.function}({', '.join(arguments)}):", "")]
    for name, size in program.inputs.items():
        read = variables.read_places(program, name)
        unpacked = _list([read.get(place, "_") for place in range(size)])
        lines.append(_wrapped(f"{unpacked} = map(float, {variables.inputs[name]})", "    "))
    if program.parameters:
        lines.append(_wrapped(f"{_list([variables.nodes[node] for node in settled_nodes(program)])} = settled", "    "))
    else:
        lines += _statement_lines(program.setup, variables)
    lines += _statement_lines(program.statements, variables)
    for name, output in zip(variables.outputs, program.outputs, strict=True):
        lines.append(_wrapped(f"{name} = {_list(variables.entries(output))}", "    "))
    returned = ", ".join(variables.outputs) if variables.outputs else "()"
    return "\n".join([*lines, f"    return {returned}"])


def _statement_lines(statements, variables):
    lines = []
    for statement in statements:
        right = variables.expression(statement)
        if statement.operation == DIVIDE:
            right = f"divide({', '.join(variables.nodes[operand] for operand in statement.operands)})"
        lines.append(f"    {variables.nodes[statement.number]} = {right}")
    return lines


def _careful_function(program, settled):
    """The function of `python_source`, with its parameters settled."""
    scope = {}
    exec(compile(python_source(program), "<robot_dynamics>", "exec"), scope)
    function = scope[Variables(program, Names(RESERVED), _literal).function]
    if not program.parameters:
        return function
    return functools.partial(function, settled=[settled[node] for node in settled_nodes(program)])


@functools.cache
def _careful_operations():
    """{operation: function} with the results of compiled code, never an exception."""
    scope = {"math": math}
    exec("\n".join(HELPERS.values()), scope)
    operations = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": scope["divide"]}
    found = {operation: operations[sign] for operation, sign in INFIX.items()}
    return found | {operation: scope[name] for operation, name in FUNCTIONS.items()}


def _settled(program, parameters):
    """{node: float} of constants, of parameters and of what follows from them."""
    values, operations = constants(program), _careful_operations()
    parameters = parameters or {}
    for number, operation, operands in program.leaves:
        if operation == PARAMETER:
            if operands[0] not in parameters:
                raise QuestionError(f"parameter {operands[0]!r} of model {program.name!r} has no value: give it one")
            values[number] = float(parameters[operands[0]])
    for number, operation, operands in program.setup:
        values[number] = operations[operation](*(values[operand] for operand in operands))
    return values


def _samples(program, inputs):
    """The inputs as arrays (N, size), all with the same N."""
    if len(inputs) != len(program.inputs):
        raise QuestionError(f"{len(inputs)} arrays are given: {', '.join(map(repr, program.inputs))} are needed")
    arrays = [np.asarray(given, dtype=float) for given in inputs]
    for (name, size), array in zip(program.inputs.items(), arrays, strict=True):
        if array.ndim != 2 or array.shape[1] != size or len(array) != len(arrays[0]):
            raise QuestionError(f"{name!r} has shape {array.shape}: (N, {size}), N the same for all inputs, is needed")
    return arrays


def _compiled(program, packed, lines, scope):
    """The function of some lines and of the names that they read."""
    text = "\n    ".join([f"def {packed.function}({', '.join(packed.inputs.values())}):", *lines])
    exec(compile(text, "<robot_dynamics>", "exec"), scope)
    function = scope[packed.function]
    function.__doc__ = _summary(program)
    return function


class _Packed:
    """The statements of a program in few and fast lines.

    What one operation alone reads is computed within its line, and a local whose value is no longer read takes another
    one: Python is slower from the 257th local on, and NumPy where arrays do not fit the cache.

    function, inputs: as in Variables; lines: of the body. Names of locals end in _, which no other identifier does.
    """

    def __init__(self, program, settled, vectorised):
        names = Names(RESERVED)
        self.function = names.take(program.name, "model")
        self.inputs = {name: names.take(name, "input") for name in program.inputs}
        self.lines = []
        self._vectorised = vectorised
        self._texts = {number: decimal(value, "inf", "nan") for number, value in settled.items()}
        for number, operation, operands in program.leaves:
            if operation == INPUT:
                self._texts[number] = self._entry(*operands)
        self._left = Counter(operand for statement in program.statements for operand in statement.operands)
        self._returned = {node for output in program.outputs for node, _ in output.entries}
        self._within, self._locals, self._free = {}, {}, []
        for statement in program.statements:
            self._add(statement)

    def entries(self, output):
        """The texts of the entries of an output, row by row."""
        return [signed(self._texts[node], sign) for node, sign in output.entries]

    def unpacking(self, program):
        """For each input its name and the list of locals that its entries go to."""
        read = {leaf.operands for leaf in program.leaves if leaf.operation == INPUT}
        for name, size in program.inputs.items():
            yield (
                self.inputs[name],
                _list([self._entry(name, place) if (name, place) in read else "_" for place in range(size)]),
            )

    def _entry(self, name, place):
        return f"{self.inputs[name]}_{place}_"

    def _add(self, statement):
        """Write a statement, or keep it back for the line of the one that reads it."""
        number, operation, operands = statement
        texts, reads, size = [], [], 1
        for operand in operands:
            text, others, operations = self._within.pop(operand, (self._texts.get(operand), [operand], 0))
            texts.append(text)
            reads += others
            size += operations
        text = (
            SIGN_WITHIN.format(*texts) if operation == SIGN and not self._vectorised else expression(operation, texts)
        )
        if size < LARGEST_EXPRESSION and self._left[number] == 1 and number not in self._returned:
            self._within[number] = f"({text})", reads, size
        else:
            self._keep(number, text, reads)

    def _keep(self, number, text, reads):
        """Write a line that gives the value of a node to a local, one that is free after the line has read."""
        for operand in reads:
            self._left[operand] -= 1
            if not self._left[operand] and operand not in self._returned and operand in self._locals:
                self._free.append(self._locals.pop(operand))
        self._locals[number] = self._free.pop() if self._free else f"t{len(self._locals)}_"
        self._texts[number] = self._locals[number]
        self.lines.append(f"{self._locals[number]} = {text}")
