"""Whether the evidence of a change lasts: without its best second, too, the change explains the residuals.

A change that is real shows whenever the motion excites it. A single event is no change that lasts: a stop within 0.1 s
has efforts that neither the model nor the filters reproduce, and any change can explain them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.checking.change_test import INDEPENDENCE_DURATION, ChangeTest
from robot_dynamics.checking.whitening import WhiteningFilter

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.fault_signals import FaultSignals


def lasting_gain(signals: FaultSignals, whitening: WhiteningFilter, effect: Array) -> float:
    """Increase of the logarithm of the likelihood by a change, without the second in which it increases most.

    Parameters
    ----------
    signals : residuals and their predictors.
    whitening : filter of the noise beside the change.
    effect : (N, n) effect of the change on the residuals [N m or N].
    """
    gains = _log_likelihood_gains(signals, whitening, effect)
    length = min(len(gains), max(1, round(INDEPENDENCE_DURATION / signals.step)))
    first = int(np.argmax(np.convolve(gains, np.ones(length), "valid")))
    valid = signals.valid.copy()
    valid[first : first + length] = False
    # the errors of the model are fitted anew: those of the best second may be in all others
    rest = WhiteningFilter(whitening.filters, whitening.deviations, valid)
    return float(_log_likelihood_gains(replace(signals, valid=valid), rest, effect).sum())


def _log_likelihood_gains(signals: FaultSignals, whitening: WhiteningFilter, effect: Array) -> Array:
    """Increase (N,) of the logarithm of the likelihood of each sample by an effect (N, n), for given noise."""
    without, beside = (ChangeTest(signals, whitening, signals.residuals - each) for each in (0.0, effect))
    gains: Array = 0.5 * (without.white_residuals**2 - beside.white_residuals**2).sum(axis=1)
    return gains
