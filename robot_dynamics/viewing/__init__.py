"""Robots as pictures in three dimensions: in the browser, and as pages that open without a network."""
