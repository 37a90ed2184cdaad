"""Observer of the external efforts by the generalized momentum.

With the momentum p and its known rate u (actuators, friction, weights, motion) the external efforts are τ_ext = ṗ - u.
The residual r is τ_ext through a low-pass filter, without the derivative of a signal:

    r = K (p - p_0 - ∫ (u + r) dt),   hence ṙ = K (τ_ext - r)

A. De Luca and R. Mattone, Sensorless robot collision detection and hybrid force/motion control, ICRA 2005.

Within a sample of duration h the mean of τ_ext is e = (p_k - p_(k-1)) / h - u. For constant e the filter has the exact
solution

    r_k = r_(k-1) + (1 - exp(-K h)) (e - r_(k-1))

which needs no integral that could drift, and holds for any h: uneven stamps change the noise, not the mean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike


class MomentumObserver:
    """Residuals of m generalized momenta, sample by sample.

    Parameters
    ----------
    bandwidth : array_like, shape () or (m,)
        K [1/s]; the residual follows external efforts with the time constant 1 / K.
    size : int
        m

    Attributes
    ----------
    residual : ndarray, shape (m,)
        r, external efforts [N m or N]; of a base the wrench [N, N m]. Zero after a restart.
    age : float
        Time since the restart [s].
    decay : ndarray, shape (m,)
        exp(-K h) of the last sample.

    Raises
    ------
    InvalidInputError
        A bandwidth is not a number above zero.
    """

    def __init__(self, bandwidth: ArrayLike, size: int) -> None:
        gains = np.asarray(bandwidth, dtype=float)
        if not (np.isfinite(gains) & (gains > 0)).all() or gains.shape not in ((), (size,)):
            raise InvalidInputError(f"bandwidth {bandwidth!r}: a number above 0 is needed, or {size} of them [1/s]")
        self._bandwidth: Array = np.broadcast_to(gains, (size,))
        self.residual = np.zeros(size)
        self.decay = np.ones(size)
        self.age = 0.0
        self._momentum: Array | None = None
        self._rate = np.zeros(size)

    def restart(self) -> None:
        """Forget all samples: the next one is the first."""
        self._momentum = None
        self.residual = np.zeros_like(self.residual)
        self.age = 0.0

    def update(self, step: float, momentum: Array, rate: Array) -> Array:
        """Residual (m,) at a sample.

        Parameters
        ----------
        step : float
            Time since the last sample [s], above zero. It is not read at the first sample.
        momentum, rate : ndarray, shape (m,)
            p, and u at this time. Within the step u is the mean of that at both ends.
        """
        if self._momentum is not None:
            self.decay = np.exp(-self._bandwidth * step)
            external = (momentum - self._momentum) / step - 0.5 * (rate + self._rate)
            self.residual = external + self.decay * (self.residual - external)
            self.age += step
        self._momentum = momentum
        self._rate = rate
        return self.residual
