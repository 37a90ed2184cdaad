"""Delays of messages between clocks that do not agree."""

import numpy as np
import pytest

from robot_dynamics.control.transit import WINDOW, TransitTimes

MS = 1_000_000  # [ns]


@pytest.mark.parametrize("offset", [0, 3_000_000_000, -(10**18)])
def test_delays_do_not_depend_on_the_offset_between_the_clocks(offset):
    rng = np.random.default_rng(0)
    transit = TransitTimes()
    published = 10**18 + np.arange(5 * WINDOW) * MS
    delays = rng.integers(0, MS // 2, len(published))
    delays[:: WINDOW // 4] = 0
    queued = slice(2 * WINDOW + 100, 2 * WINDOW + 400)  # all are received at once after a stall of the receiver
    delays[queued] = published[queued.stop] - published[queued]
    computed = [transit.delay(p + d, p - offset) for p, d in zip(published.tolist(), delays.tolist(), strict=True)]
    np.testing.assert_allclose(computed, delays * 1e-9, atol=1e-12)


def test_delays_are_right_again_some_messages_after_a_clock_is_set():
    transit = TransitTimes()
    for k in range(100):
        assert transit.delay(10**18 + k * MS, 10**18 + k * MS) == 0.0
    late = [transit.delay(10**18 + k * MS, 10**18 + (k - 50) * MS) for k in range(100, 100 + 2 * WINDOW)]
    assert late[0] == pytest.approx(0.05) and late[-1] == 0.0
    assert transit.delay(10**18, 10**18 + 7 * MS) == 0.0, "a clock that is set ahead counts at once"


def test_unknown_publication_time_gives_zero_delay():
    transit = TransitTimes()
    assert transit.delay(10**18, 0) == 0.0
    transit.delay(10**18, 10**18)
    assert transit.delay(2 * 10**18, 0) == 0.0
    transit.restart()
    assert transit.delay(2 * 10**18, 10**18) == 0.0
