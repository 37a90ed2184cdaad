"""Warnings of a fit, each with a remedy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.identification.identification_model import IdentificationModel
    from robot_dynamics.identification.motion_blocks import MotionBlocks

MIN_BLOCKS = 8  # fewer blocks tell little of the scatter between blocks
SIGNIFICANT_DEVIATIONS = 2.0  # by which a parameter that cannot be negative is below zero
SIGN_REMEDIES = {
    "Ia": (
        "rotor inertia",
        "the motion hardly distinguishes rotors from bodies; compare --no-rotor-inertia, and record larger "
        "accelerations; a coarse encoder needs a lower --cutoff",
    ),
    "Fv": (
        "viscous friction",
        "check signs and units of velocities and efforts; friction that falls with velocity (Stribeck) has this "
        "effect at low speeds: record faster motions",
    ),
    "Fs": (
        "Coulomb friction",
        "check signs of velocities and efforts, and record motions that change direction often",
    ),
}


def excitation_warnings(model: IdentificationModel, excited: BoolArray) -> Iterator[str]:
    """Name the parameters that no sample depends on; excited: (P,)."""
    if not excited.all():
        names = [name for name, excited in zip(model.names, excited, strict=True) if not excited]
        yield f"the motion does not excite {', '.join(names)}"


def block_warnings(blocks: MotionBlocks) -> Iterator[str]:
    """Warn of recordings that are too short for the scatter between blocks."""
    if len(blocks) < MIN_BLOCKS:
        yield (
            f"{len(blocks)} s of different motion: the standard deviations are themselves uncertain with fewer "
            f"than {MIN_BLOCKS}; record more"
        )


def sign_warnings(model: IdentificationModel, values: Array, deviations: Array, seen: BoolArray) -> Iterator[str]:
    """Warn of rotor inertias and frictions that are negative by more than their deviations, all (P,)."""
    for kind, (meaning, remedy) in SIGN_REMEDIES.items():
        negative = [
            f"{name} {value / deviation:.1f}"
            for name, value, deviation, is_seen in zip(model.names, values, deviations, seen, strict=True)
            if name.startswith(f"{kind}.") and is_seen and value < -SIGNIFICANT_DEVIATIONS * deviation
        ]
        if negative:
            yield f"negative {meaning} (in standard deviations: {', '.join(negative)}): {remedy}"
