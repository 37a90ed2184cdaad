"""Text of a function of LLVM IR while it is made: lines, blocks, names and memory."""

from robot_dynamics.codegen.procedure.index_checks import IndexChecks
from robot_dynamics.codegen.procedure.ir_types import ir_type


class FunctionText:
    """The lines of a function of LLVM IR, while they are made.

    Parameters
    ----------
    lanes : int
        Samples that the function computes at once: each number is a vector with one entry for each.

    Attributes
    ----------
    lanes : int
    lines : list of str
    is_ended : bool
        Whether the last line leaves its block: nothing that follows is reached.
    mask : str or None
        Operand of the type <lanes x i1>: the lanes that are computed. All others keep what they have. None for all.
    location : str
        Function, file and line of the statement that is staged.
    index_checks : IndexChecks

    Notes
    -----
    A function of several lanes has an integer in memory, %rejected, with a bit for each lane that it does not compute.
    """

    def __init__(self, lanes: int = 1) -> None:
        self.lanes = lanes
        self.allocations: list[str] = []
        self.lines: list[str] = []
        self.is_ended = False
        self.mask: str | None = None
        self.location = ""
        self.index_checks = IndexChecks()
        self._count = 0

    @property
    def number_type(self) -> str:
        """The type of a number."""
        return ir_type("double", self.lanes)

    @property
    def number_suffix(self) -> str:
        """The end of the names of functions of LLVM that take numbers."""
        return "f64" if self.lanes == 1 else f"v{self.lanes}f64"

    def name(self) -> str:
        """A new name of a value."""
        self._count += 1
        return f"%v{self._count}"

    def assign(self, instruction: str) -> str:
        """Append an instruction; the name of its result."""
        name = self.name()
        self.lines.append(f"{name} = {instruction}")
        return name

    def append(self, line: str) -> None:
        """Append a line without a result."""
        self.lines.append(line)

    def allocate(self, numbers: int) -> str:
        """The address of memory for some numbers, which lasts until the function ends."""
        return self._allocate(numbers, self.number_type)

    def allocate_pointers(self, count: int) -> str:
        """The address of memory for some pointers, which lasts until the function ends."""
        return self._allocate(count, "ptr")

    def _allocate(self, count: int, element: str) -> str:
        name = self.name()
        self.allocations.append(f"{name} = alloca [{max(1, count)} x {element}], align 64")
        return name

    def reject(self, lanes: str) -> None:
        """Leave lanes, those whose bit is set in an integer operand, to the function of one sample."""
        bits = f"i{self.lanes}"
        if self.mask is not None:
            computed = self.assign(f"bitcast {ir_type('i1', self.lanes)} {self.mask} to {bits}")
            lanes = self.assign(f"and {bits} {lanes}, {computed}")
        before = self.assign(f"load {bits}, ptr %rejected, align 8")
        after = self.assign(f"or {bits} {before}, {lanes}")
        self.append(f"store {bits} {after}, ptr %rejected, align 8")

    def label(self) -> str:
        """A new name of a block."""
        self._count += 1
        return f"block{self._count}"

    def begin(self, label: str) -> None:
        """Begin a block."""
        if not self.is_ended:
            self.lines.append(f"br label %{label}")
        self.lines.append(f"{label}:")
        self.is_ended = False

    def jump(self, label: str) -> None:
        """Leave the block for another one."""
        if not self.is_ended:
            self.lines.append(f"br label %{label}")
        self.is_ended = True

    def branch(self, condition: str, then: str, otherwise: str) -> None:
        """Leave the block for one of two others, by an operand of the type i1."""
        self.lines.append(f"br i1 {condition}, label %{then}, label %{otherwise}")
        self.is_ended = True
