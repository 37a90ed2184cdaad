"""Signals in which faults are looked for, with random residuals."""

import numpy as np

from robot_dynamics.checking.fault_signals import FaultSignals

STEP = 0.02  # [s]


def random_signals(valid):
    """Return FaultSignals of two joints with residuals of unit variance; valid: (N, 2) as of FaultSignals."""
    N = len(valid)
    rng = np.random.default_rng(0)
    times = STEP * np.arange(N)
    velocities = np.stack([np.sin(3 * times), np.cos(2 * times)], axis=1)
    return FaultSignals(
        times=times,
        step=STEP,
        band=4.0,
        residuals=rng.normal(size=(N, 2)),
        predicted=np.cumsum(rng.normal(size=(N, 2)), axis=0),
        velocity_signs=np.sign(velocities),
        velocities=velocities,
        payload_efforts=np.zeros((N, 2, 4)),
        offset_efforts=np.zeros((N, 2, 2)),
        valid=valid,
        resting=~valid,
        recorded=np.ones(N),
    )
