"""Types of arrays. A type says what the entries are; the docstring says the shape: ``(..., n)`` means n entries behind
any batch axes."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Array", "ArrayLike", "BoolArray", "IntArray", "ScalarArray"]

Array: TypeAlias = NDArray[np.float64]
"""Numbers."""

BoolArray: TypeAlias = NDArray[np.bool_]
"""Truth values, one for each sample or entry."""

IntArray: TypeAlias = NDArray[np.intp]
"""Indices."""

ScalarArray: TypeAlias = NDArray[Any]
"""Numbers, or symbols of a trace (dtype object): what a recursion over generic scalars takes and returns."""
