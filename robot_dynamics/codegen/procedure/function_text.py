"""Text of a function of LLVM IR while it is made: lines, blocks, names and memory."""


class FunctionText:
    """The lines of a function of LLVM IR, while they are made.

    Attributes
    ----------
    lines : list of str
    is_ended : bool
        Whether the last line leaves its block: nothing that follows is reached.
    """

    def __init__(self) -> None:
        self.allocations: list[str] = []
        self.lines: list[str] = []
        self.is_ended = False
        self._count = 0

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

    def allocate(self, doubles: int) -> str:
        """The address of memory for some numbers, which lasts until the function ends."""
        name = self.name()
        self.allocations.append(f"{name} = alloca [{max(1, doubles)} x double], align 64")
        return name

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
