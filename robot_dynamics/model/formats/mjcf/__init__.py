"""MJCF, the format of MuJoCo, compiled by the package mujoco."""
