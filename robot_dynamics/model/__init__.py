"""Robots as data, and the formats that describe them. No dynamics algorithms."""
