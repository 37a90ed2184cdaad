"""Positions that close the loops of a robot: Newton's method from a seed, for many samples at once.

What is evaluated comes from outside: `evaluate(t)` gives for positions t (N, m) of the joints that follow no other one
(residual (N, rows), step (N, dependent), ...): Newton's step of the dependent joints, and what else there is to tell.
"""

import numpy as np

CLOSED = 1e-13  # residual [characteristic lengths, rad] at which nothing is left to gain
ITERATIONS = 40
HALVINGS = 6
WORTH_IT = 0.999  # of the residual that may be left after a step, where it is worth to go on
LONGEST_STEP = 0.5  # [rad or characteristic lengths]: a Newton step that is longer knows nothing of where it leads


def newton(evaluate, t, dependent, longest, iterations=ITERATIONS):
    """(t (N, m), what `evaluate` gives there): the positions `dependent` moved until the loops are closed, or until
    nothing brings their ends closer.

    t: (N, m), where to begin; dependent: numbers of columns; longest: (dependent,) the longest step of each.
    """
    t = np.array(t)
    found = [np.array(value) for value in evaluate(t)]
    waiting = np.arange(len(t))
    for _ in range(iterations):
        waiting = waiting[np.abs(found[0][waiting]).max(axis=-1, initial=0) > CLOSED]
        if not len(waiting):
            break
        step = np.nan_to_num(found[1][waiting], posinf=0, neginf=0)
        step /= np.maximum(1.0, np.abs(step / longest).max(axis=-1, keepdims=True))
        waiting = _improved(evaluate, t, found, dependent, waiting, step)
    return t, found


def _improved(evaluate, t, found, dependent, waiting, step):
    """Those of the samples `waiting` whose loops are nearer to being closed after their step or a part of it; t and
    found hold them then."""
    before = np.linalg.norm(found[0][waiting], axis=-1)
    left, share, better = np.arange(len(waiting)), 1.0, []
    for _ in range(HALVINGS):
        trial = t[waiting[left]]
        trial[:, dependent] += share * step[left]
        tried = evaluate(trial)
        gains = np.linalg.norm(tried[0], axis=-1) < WORTH_IT * before[left]
        samples = waiting[left[gains]]
        t[samples] = trial[gains]
        for values, now in zip(found, tried, strict=True):
            values[samples] = now[gains]
        better.append(samples)
        left, share = left[~gains], share / 2
        if not len(left):
            break
    return np.sort(np.concatenate(better))
