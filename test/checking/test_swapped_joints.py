"""The search for swapped columns keeps a bounded number of samples, however the recording is divided."""

import numpy as np

from robot_dynamics.checking.swapped_joints import MAX_ROWS, MIN_RATE, SwapSearch
from robot_dynamics.recordings.joint_motions import Motion

ROW = np.zeros((1, 7))


def motion_of_one_sample(time):
    return Motion(
        time=time,
        rate=100.0,
        cutoff=8.0,
        q=ROW,
        qd=ROW,
        qdd=ROW,
        efforts=ROW,
        unfiltered_efforts=ROW,
        has_efforts=np.ones(7, dtype=bool),
        moving=ROW == 0,
    )


def test_many_motions_of_one_sample_are_thinned_out():
    search = SwapSearch(predictor=None)
    for k in range(MAX_ROWS + 1):
        search.add(motion_of_one_sample(0.1 * k))
    assert MAX_ROWS / 3 < sum(map(len, search._motions)) <= MAX_ROWS
    assert search._motions[0].time == 0 and search._motions[-1].time > 0.09 * MAX_ROWS
    assert search._rate >= MIN_RATE
