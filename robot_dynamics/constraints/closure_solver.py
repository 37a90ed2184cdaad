"""Where all joints of a robot are, and how they move together: mimic joints told by the others, loops closed."""

import math
import time
from contextlib import contextmanager
from functools import partial

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.constraints.mobility import CLOSURE_TOLERANCE, NEARLY_CLOSED_RESIDUAL, find_widest_loop
from robot_dynamics.constraints.topology import build_topology
from robot_dynamics.errors import SingularModelError

# The least quality of a configuration whose rates mean something. Next to a singular position a deviation δ leaves a
# residual of δ² only, and the quality is about δ²: this is what positions within CLOSES of one have, and some more.
MIN_QUALITY = 10 * CLOSURE_TOLERANCE
BLOCK_SIZE = 2000  # whose loops are closed together: as many as a cache has place for


class ClosureSolver:
    """The Configurations of a robot, from positions as users give them.

    independent, dependent: numbers of the joints that are given, and of those that loops place. programs: the
    CompiledModels that Newton's steps may come from, or None.
    """

    def __init__(self, robot, programs=None):
        self.robot, self._coupling, self._programs = robot, build_topology(robot), programs
        self.independent, self.dependent = self._coupling.independent, self._coupling.dependent
        self._names = [joint.name for joint in robot.joints]

    def split_positions(self, q):
        """(q (..., n), seed (..., dependent) or None) of positions (..., n), or with loops of all joints: nan in a seed
        says nothing of a joint, and no seed nothing of any."""
        if self.robot.loops:
            try:
                everyone = np.array(q, dtype=float)
            except (TypeError, ValueError):
                everyone = np.zeros(0)  # refused below
            if everyone.ndim and everyone.shape[-1] == len(self._names):
                return self._with_seed(everyone)
        names = ", ".join(self._names[number] for number in self.independent)
        joints = f"joints ({names})"
        if self.robot.loops:
            joints += f", or (..., {len(self._names)}), one for each of all joints ({', '.join(self._names)})"
        return require_finite("positions", q, len(self.independent), joints), None

    def _with_seed(self, q):
        """Positions of all joints, in which nan may stand for those that loops place."""
        seed = q[..., self.dependent]
        open_ = np.isnan(seed)
        q[..., self.dependent] = np.where(open_, 0.0, seed)
        q = require_finite("positions", q, len(self._names), f"joints ({', '.join(self._names)})")
        return q[..., self.independent], None if open_.all() else seed

    def close_loops(self, q, name_sample=True):
        """Positions (..., all joints) of all joints, from those that `checked` takes.

        numbered: whether a refusal says which sample is meant. Raises SingularModelError where the loops do not close,
        or are singular.
        """
        q, seed = self.split_positions(q)
        if not self.robot.loops:
            return q @ self._coupling.S.T + self._coupling.offset
        batch = q.shape[:-1]
        samples = q.reshape(math.prod(batch), q.shape[-1])
        t = np.empty((len(samples), len(self._coupling.non_mimic_joints)))
        for block, found in self._blocks(samples, seed):
            self._refuse_open(found, block.start, many=name_sample and q.ndim > 1)
            t[block] = found.t
        return self._everyone(t).reshape(*batch, len(self._names))

    def try_close_loops(self, q):
        """(positions (..., all joints), closed (...)): as `closed`, but of those samples at which the loops do not
        close, or are singular, it is told and nothing raised."""
        q, seed = self.split_positions(q)
        batch, samples = q.shape[:-1], q.reshape(-1, q.shape[-1])
        t, good = np.empty((len(samples), len(self._coupling.non_mimic_joints))), np.empty(len(samples), dtype=bool)
        for block, found in self._blocks(samples, seed):
            t[block], good[block] = (
                found.t,
                found.is_closed & (found.quality > MIN_QUALITY) & ~found.has_crossed_singularity,
            )
        return self._everyone(t).reshape(*batch, len(self._names)), good.reshape(batch)

    def _blocks(self, samples, seed):
        """(slice, Closed) of one block of samples (N, n) after the other, with a seed (..., dependent) or None."""
        seeds = None if seed is None else seed.reshape(len(samples), seed.shape[-1])
        for first in range(0, len(samples), BLOCK_SIZE):
            block = slice(first, first + BLOCK_SIZE)
            with self._steps() as step:  # left before the block is handed out: what it sets is no caller's business
                found = self._coupling.solve_closure(samples[block], None if seeds is None else seeds[block], step)
            yield block, found

    def close_trajectory(self, q):
        """Positions (N, all joints) along a trajectory q (N, n) or (N, all joints): each sample is closed from the one
        before it, the first as by `closed`."""
        q, seed = self.split_positions(q)
        if q.ndim != 2 or not self.robot.loops:
            return self.close_loops(q)
        found = []
        with self._steps() as step:
            for sample in range(len(q)):
                if sample:
                    previous_positions = found[-2] if sample > 1 else None
                    closed = self._coupling.follow_path(
                        found[-1], q[sample, None], step, previous_positions=previous_positions
                    )
                else:
                    closed = self._coupling.solve_closure(q[:1], None if seed is None else seed[:1], step)
                self._refuse_open(closed, sample, many=True)
                found.append(closed.t)
        return self._everyone(np.concatenate(found or [np.zeros((0, len(self._coupling.non_mimic_joints)))]))

    def continue_branch(self, q, previous, velocities=None):
        """Positions (..., all joints) for q (..., n), on the branch that leads there from positions near them.

        previous: (..., all joints) positions that close the loops; velocities: (..., all joints) there, None where the
        tangent shows where they lead. Raises SingularModelError as `closed`, and where the branch bends.
        """
        names = ", ".join(self._names[number] for number in self.independent)
        q = require_finite("positions", q, len(self.independent), f"joints ({names})")
        everyone = len(self._names), f"joints ({', '.join(self._names)})"
        previous = require_finite("previous", previous, *everyone)
        velocities = previous[..., :0] if velocities is None else require_finite("velocities", velocities, *everyone)
        if not self.robot.loops:
            return self.close_loops(q)
        batch = np.broadcast_shapes(q.shape[:-1], previous.shape[:-1], velocities.shape[:-1])
        samples = [np.broadcast_to(array, (*batch, array.shape[-1])).reshape(math.prod(batch), array.shape[-1])
                   for array in (q, previous, velocities)]  # fmt: skip
        with self._steps() as step:
            closed = self._coupling.continue_branch(*samples, step)
            self._refuse_open(closed, many=bool(batch))
        return self._everyone(closed.t).reshape(*batch, len(self._names))

    @property
    def attitudes(self):
        """The Attitudes of platforms that have a chart."""
        return self._coupling.attitudes

    @property
    def closed_positions(self):
        """(all joints,) positions that close the loops, or the initial ones where there are none."""
        start = np.array([self.robot.joints[number].initial_position for number in self._coupling.non_mimic_joints])
        return self._everyone(
            start if self._coupling.reference_positions is None else self._coupling.reference_positions
        )

    def _everyone(self, t):
        return t @ self._coupling.S.T + self._coupling.offset

    @contextmanager
    def _steps(self):
        """What computes Newton's steps: a program where it is ready, else None, and then how long it takes is noted."""
        program = None if self._programs is None else self._programs.get_ready("closure")
        started = time.perf_counter()
        with np.errstate(all="ignore"):  # what does not close is refused
            yield None if program is None else partial(_closing_step, program)
        if program is None and self._programs is not None:
            self._programs.record_time(time.perf_counter() - started, "closure")

    def state_at(self, q, name_sample=True, use_charts=True):
        """The Configuration at positions that `checked` takes. numbered: as for `closed`, in_charts: for `of_all`."""
        return self.state_at_closed(self.close_loops(q, name_sample), use_charts)

    def state_at_closed(self, q, use_charts=True):
        """The Configuration at positions (..., all joints) that are known to close the loops.

        in_charts: whether platforms move in charts of their attitudes, and not by rates of yaw, pitch and roll.
        """
        with np.errstate(all="ignore"):
            return self._coupling.charted_state_at(q) if use_charts else self._coupling.state_at(q)

    def _refuse_open(self, found, first=0, many=False):
        """Raise SingularModelError for the first sample whose loops are open or singular.

        found: Closed; first: what the first sample is called, where there are many.
        """
        good = found.is_closed & (found.quality > MIN_QUALITY) & ~found.has_crossed_singularity
        if good.all():
            return
        sample, left = np.argmin(good), np.abs(found.residual).max(axis=-1)
        where = f" at sample {first + sample}" if many else ""
        with np.errstate(all="ignore"):
            condition = f"(condition number {self._coupling.condition_number(found.t[sample]):.3g})"
            name, distance, angle = find_widest_loop(self.robot, found.residual[sample])
        if not left[sample] <= CLOSURE_TOLERANCE:
            hint = ". These positions are out of reach, or need a seed of all joints nearer to where it closes"
            if left[sample] < NEARLY_CLOSED_RESIDUAL:
                hint = "; if it is meant to close there, its axes or lengths are not exact"
            raise SingularModelError(
                f"loop {name!r} does not close{where}: its ends stay {distance:.3g} m and {angle:.3g} rad apart "
                f"{condition}{hint}"
            )
        if not found.quality[sample] > MIN_QUALITY:
            placed = ", ".join(self._names[number] for number in self.dependent)
            raise SingularModelError(
                f"loop {name!r} is singular{where}: it closes (residual {left[sample]:.2g}), but does not tell where "
                f"{placed} are {condition}"
            )
        raise SingularModelError(
            f"the loops close{where} in another assembly mode than at the initial positions {condition}: a singular "
            "position lies between, or nearly. Give the positions of all joints, near those that are meant"
        )


def _closing_step(program, t):
    """What the program of the model `closure` gives at t, one sample (m,) or many (N, m)."""
    return program.evaluate(t) if t.ndim == 1 else program.batch(t)
