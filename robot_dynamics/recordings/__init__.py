"""Bags against the model: recordings are read, filtered, compared with the efforts of `Dynamics`, and reported."""
