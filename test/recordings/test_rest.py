import numpy as np

from robot_dynamics.recordings.rest import MARGIN_PERIODS, REST_WINDOW, moving_samples

RATE = 100.0
CUTOFF = 8.0
TIMES = np.arange(0, 12, 1 / RATE)


def test_a_pause_and_the_reach_of_the_filter_around_it_do_not_move():
    """A joint moves, holds its position from 4 s to 8 s, and moves on."""
    held = np.clip(TIMES, 4, 8) - 4
    q = 0.3 * np.sin(2 * np.pi * 0.5 * (TIMES - held))[:, None]
    moving = moving_samples(q, RATE, CUTOFF)[:, 0]
    margin = MARGIN_PERIODS / CUTOFF
    assert not moving[(TIMES > 4 - margin + 0.02) & (TIMES < 8 + margin - 0.02)].any()
    far = REST_WINDOW + margin
    assert moving[(TIMES < 4 - far) | (TIMES > 8 + far)].all()


def test_joints_that_reverse_move():
    q = 0.1 * np.sin(2 * np.pi * 0.3 * TIMES)[:, None]
    assert moving_samples(q, RATE, CUTOFF).all()


def test_noise_of_an_encoder_at_rest_is_no_motion():
    q = 1 + 1e-4 * np.random.default_rng(0).normal(size=(len(TIMES), 2))
    assert not moving_samples(q, RATE, CUTOFF).any()
