"""The onset that is named: of the most likely window, not between two likely moments."""

import numpy as np
import pytest

from robot_dynamics.checking.fault_search import _most_likely_row


@pytest.mark.parametrize(
    ("likely", "row"),
    [
        ({40: 1.0}, 40),
        ({40: 1.0, 70: 0.9, 10: 1e-3}, 40),  # the median of all is between two of them
        ({60: 1.0, **dict.fromkeys(range(20, 26), 0.5)}, 22),  # six likely rows against a single one
        ({1: 1.0}, 1),
        ({99: 1.0}, 99),
    ],
)
def test_most_likely_row_is_the_median_of_the_most_likely_window(likely, row):
    likelihoods = np.zeros(100)
    likelihoods[list(likely)] = list(likely.values())
    assert _most_likely_row(likelihoods, 12) == row
