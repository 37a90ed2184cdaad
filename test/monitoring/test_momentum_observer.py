"""The observer beside the closed solution of its filter, for uneven stamps and rates that change within samples."""

import numpy as np
import pytest

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.monitoring.momentum_observer import MomentumObserver

K = 40.0


def momenta(times, external, rate):
    """Momentum (N,) that constant external efforts and a rate of the known efforts, linear in time, build up."""
    slope, start = rate
    return external * times + start * times + 0.5 * slope * times**2, start + slope * times


@pytest.mark.parametrize("slope", [0.0, -300.0])
def test_constant_external_efforts_pass_a_first_order_filter_whatever_the_stamps(slope):
    steps = np.random.default_rng(0).exponential(2e-3, 400)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    p, u = momenta(times, 7.0, (slope, 100.0))
    observer = MomentumObserver(K, 1)
    residuals = [observer.update(step, p[k : k + 1], u[k : k + 1])[0] for k, step in enumerate([0.0, *steps])]
    np.testing.assert_allclose(residuals, 7.0 * (1 - np.exp(-K * times)), rtol=0, atol=1e-9)
    assert observer.age == pytest.approx(times[-1])


def test_external_efforts_of_single_samples_decay_exactly():
    """Steps of a hundred time constants are no problem: no gain above one."""
    observer = MomentumObserver(K, 1)
    observer.update(0.0, np.zeros(1), np.zeros(1))
    observer.update(2.5, np.array([2.5 * 3.0]), np.zeros(1))
    assert observer.residual == pytest.approx(3.0)
    observer.update(0.025, np.array([7.5]), np.zeros(1))
    assert observer.residual == pytest.approx(3.0 * np.exp(-1))


def test_jitter_of_stamps_and_noise_do_not_drift():
    """An hour of samples at 100 Hz whose stamps scatter by 1 ms, with noise on momentum and efforts."""
    rng = np.random.default_rng(1)
    count = 360_000
    true_times = np.arange(count) * 0.01
    stamps = np.sort(true_times + rng.uniform(-1e-3, 1e-3, count))
    known = 20.0 * np.sin(true_times)
    p = 20.0 * (1 - np.cos(true_times)) + 0.01 * rng.normal(size=count)
    u = known + rng.normal(size=count)
    observer = MomentumObserver(K, 1)
    tail = []
    for k in range(count):
        observer.update(stamps[k] - stamps[k - 1] if k else 0.0, p[k : k + 1], u[k : k + 1])
        if k >= count - 60_000:
            tail.append(observer.residual[0])
    assert abs(np.mean(tail)) < 0.02 and np.std(tail) < 1.5


def test_restart_forgets_and_bandwidths_may_differ():
    observer = MomentumObserver([10.0, 100.0], 2)
    observer.update(0.0, np.zeros(2), np.zeros(2))
    residual = observer.update(0.01, np.full(2, 0.05), np.zeros(2))
    np.testing.assert_allclose(residual, 5.0 * (1 - np.exp([-0.1, -1.0])))
    observer.restart()
    assert observer.age == 0 and not observer.residual.any()
    assert not observer.update(0.01, np.full(2, 9.0), np.zeros(2)).any()  # the first sample


@pytest.mark.parametrize("bandwidth", [0.0, -1.0, np.nan, np.inf, [1.0, 2.0, 3.0]])
def test_bandwidth_must_be_a_positive_number(bandwidth):
    with pytest.raises(InvalidInputError, match="above 0 is needed, or 2 of them"):
        MomentumObserver(bandwidth, 2)
