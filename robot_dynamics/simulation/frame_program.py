"""Positions and velocities of named frames, by a compiled program."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_dynamics.errors import CompilationError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
    from robot_dynamics.codegen.jit.python_program import PythonProgram
    from robot_dynamics.dynamics import Dynamics


class FrameProgram:
    """Kinematics of named link frames of a robot.

    Parameters
    ----------
    dynamics : Dynamics
    names : sequence of str
        Names of k link frames.
    independent : tuple of int, optional
        Numbers of the joints that rates belong to; None for those of Dynamics.joint_names.

    Attributes
    ----------
    program : CompiledProgram or PythonProgram
        The model `frames`.
    """

    def __init__(self, dynamics: Dynamics, names: Sequence[str], independent: tuple[int, ...] | None = None) -> None:
        # few simulations have wheels or ground contact: the others need no tracing
        from robot_dynamics.codegen.jit.compiled_program import compile_program
        from robot_dynamics.codegen.jit.python_program import PythonProgram
        from robot_dynamics.codegen.trace.models import frames_model

        self._has_moving_base = dynamics.robot.moving_base
        program = frames_model(dynamics.robot, names, independent=independent)
        self.program: CompiledProgram | PythonProgram
        try:
            self.program = compile_program(program)
        except CompilationError:
            self.program = PythonProgram(program)

    def __call__(self, q: Array, rates: Array) -> tuple[Array, Array, Array]:
        """Rotations (k, 3, 3), positions (k, 3) and velocities (k, 3) in frame 0.

        q: positions as the programs take them; rates (6 + n,): twist of the base and joint velocities.
        """
        base: tuple[Array, ...] = (rates[:6],) if self._has_moving_base else ()
        rotations, positions, velocities = self.program.evaluate(q, rates[6:], *base)
        return rotations, positions, velocities
