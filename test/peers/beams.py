"""Closed forms of a clamped beam's frequencies in bending."""

import numpy as np
from scipy.optimize import brentq


def clamped_free(count, length, bending, line_mass, _rotary=0.0):
    """[Hz] of Euler and Bernoulli's beam: 1 + cos λ cosh λ = 0. bending: E I [N m²]; line_mass: ρ A [kg/m]."""
    roots = [brentq(lambda x: np.cos(x) + 1 / np.cosh(x), k * np.pi, (k + 1) * np.pi) for k in range(count)]
    return np.array(roots) ** 2 / (2 * np.pi * length**2) * np.sqrt(bending / line_mass)


def rayleigh_clamped_free(count, length, bending, line_mass, rotary):
    """[Hz] of Rayleigh's beam, with rotary inertia ρ I [kg m]: E I w'''' - ρ I ẅ'' + ρ A ẅ = 0, clamped at 0; at the
    other end w'' = 0 and E I w''' = ρ I ẅ'."""

    def mismatch(omega):
        # w = e^{κx}: E I κ⁴ + ρ I ω² κ² - ρ A ω² = 0; one pair of κ is real, the other imaginary
        half = rotary * omega**2 / (2 * bending)
        root = np.sqrt(half**2 + line_mass * omega**2 / bending)
        a, b = np.sqrt(root - half), np.sqrt(root + half)  # κ = ±a, ±ib
        s, c, sh, ch = np.sin(b * length), np.cos(b * length), np.sinh(a * length), np.cosh(a * length)
        # w = A (cosh ax - cos bx) + B (sinh ax / a - sin bx / b)
        moment = [a**2 * ch + b**2 * c, a * sh + b * s]
        turning = rotary * omega**2
        shear = [
            bending * (a**3 * sh - b**3 * s) + turning * (a * sh + b * s),
            bending * (a**2 * ch + b**2 * c) + turning * (ch - c),
        ]
        return (moment[0] * shear[1] - moment[1] * shear[0]) / (ch * bending) ** 2

    below = 2 * np.pi * clamped_free(count + 1, length, bending, line_mass)  # rotary inertia lowers each a little
    roots, scan = [], np.linspace(below[0] * 0.2, below[-1], 20000)
    values = [mismatch(omega) for omega in scan]
    for k in range(len(scan) - 1):
        if values[k] * values[k + 1] < 0:
            roots.append(brentq(mismatch, scan[k], scan[k + 1], xtol=1e-9))
    return np.array(roots[:count]) / (2 * np.pi)
