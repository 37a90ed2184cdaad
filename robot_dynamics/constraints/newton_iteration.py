"""Positions that close the loops of a robot: Newton's method from a seed, for many samples at once.

What is evaluated comes from outside: `evaluate(t)` gives for positions t (N, m) of the joints that follow no other one
(residual (N, rows), step (N, dependent), ...): Newton's step of the dependent joints, and what else there is to tell.
"""

import numpy as np

NEWTON_TOLERANCE = 1e-13  # residual [characteristic lengths, rad] at which nothing is left to gain
MAX_ITERATIONS = 40
MAX_HALVINGS = 6
SUFFICIENT_DECREASE = 0.999  # of the residual that may be left after a step, where it is worth to go on
MAX_STEP = 0.5  # [rad or characteristic lengths]: a Newton step that is longer knows nothing of where it leads


def iterate_newton(
    evaluate, t, dependent, max_step, iterations=MAX_ITERATIONS, tolerance=NEWTON_TOLERANCE, advance=None
):
    """(t (N, m), what `evaluate` gives there): the positions `dependent` moved until the residual is at most `closed`,
    or until nothing brings the ends of the loops closer.

    t: (N, m), where to begin; dependent: numbers of columns; longest: (dependent,) the longest step of each. A single
    sample is evaluated as t (m,), which takes a fraction of the time. advance: positions (..., m) from positions
    (..., m) and a step (..., dependent), where that is more than a sum.
    """
    advance = advance or _sum(dependent)
    if len(t) == 1:
        t, found = _newton_of_one(evaluate, np.array(t[0]), advance, max_step, iterations, tolerance)
        return t[None], [np.asarray(value)[None] for value in found]
    t = np.array(t)
    found = [np.require(value, requirements="W") for value in evaluate(t)]
    waiting = np.arange(len(t))
    for _ in range(iterations):
        waiting = waiting[np.abs(found[0][_rows(waiting, t)]).max(axis=-1, initial=0) > tolerance]
        if not len(waiting):
            break
        step = _no_longer(found[1][_rows(waiting, t)], max_step)
        waiting = _improved(evaluate, t, found, advance, waiting, step)
    return t, found


def _sum(dependent):
    """What adds a step (..., dependent) to positions (..., m), of which `dependent` are the numbers of columns."""

    def advance(t, step):
        found = np.array(t)
        found[..., dependent] += step
        return found

    return advance


def _newton_of_one(evaluate, t, advance, max_step, iterations, tolerance):
    """As `newton`, of one sample t (m,)."""
    found = evaluate(t)
    for _ in range(iterations):
        residual = found[0]
        if not np.abs(residual).max(initial=0) > tolerance:
            break
        step, enough, share = _no_longer(found[1], max_step), SUFFICIENT_DECREASE**2 * (residual @ residual), 1.0
        for _ in range(MAX_HALVINGS):
            trial = advance(t, share * step)
            tried = evaluate(trial)
            if tried[0] @ tried[0] < enough:
                break
            share /= 2
        else:
            break
        t, found = trial, tried
    return t, found


def _no_longer(step, max_step):
    """Steps (..., dependent), shortened as a whole where a part of one is too long; none where it is not finite."""
    if not (np.abs(step) <= max_step).all():
        step = np.where(np.isfinite(step), step, 0)
        step = step / np.maximum(1.0, (np.abs(step) / max_step).max(axis=-1, keepdims=True))
    return step


def _improved(evaluate, t, found, advance, waiting, step):
    """Those of the samples `waiting` whose loops are nearer to being closed after their step or a part of it; t and
    found hold them then."""
    enough = SUFFICIENT_DECREASE**2 * _squared(found[0][_rows(waiting, t)])
    left, share, better = np.arange(len(waiting)), 1.0, []
    for _ in range(MAX_HALVINGS):
        trial = advance(t[_rows(waiting[left], t)], share * step[_rows(left, step)])
        tried = evaluate(trial)
        gains = _squared(tried[0]) < enough[left]
        samples = waiting[left[gains]]
        rows, gained = _rows(samples, t), _rows(np.flatnonzero(gains), trial)
        t[rows] = trial[gained]
        for values, now in zip(found, tried, strict=True):
            values[rows] = now[gained]
        better.append(samples)
        left, share = left[~gains], share / 2
        if not len(left):
            break
    return np.sort(np.concatenate(better))


def _rows(numbers, array):
    """Numbers of rows, in their order, as an index of an array: all of them as a slice, which copies nothing."""
    return slice(None) if len(numbers) == len(array) else numbers


def _squared(residuals):
    return np.einsum("...i,...i", residuals, residuals)
