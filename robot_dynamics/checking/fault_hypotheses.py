"""The faults that are known: how each changes the residuals, and the sizes that are physically possible."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.newton_euler.linear import solve_each

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.change_test import SizeFit
    from robot_dynamics.checking.fault_signals import FaultSignals
    from robot_dynamics.model.joint import Joint

FaultKind: TypeAlias = Literal[
    "payload", "friction", "gain", "offset", "swapped", "sign", "delay", "contact", "missing"
]

MAX_PAYLOAD_DISTANCE = 0.3  # [m] of the centre of mass of a payload from its frame
MIN_GAIN_CHANGE, MAX_GAIN_CHANGE = -0.95, 4.0  # of a drive, as a part of its gain
MAX_OFFSET = 0.5  # [rad or m] of an encoder
MAX_DELAY = 0.3  # [s]
MIN_DELAY = 0.007  # [s] that is a fault
MIN_FRICTION_CHANGE = 0.3  # that is a fault, as a part of the friction of the model: heat changes friction too
MIN_GAIN_FAULT = 0.08  # that is a fault, as a part of the gain
MIN_PAYLOAD = 0.005  # that is a fault, as a part of the mass of the robot


@dataclass(frozen=True, eq=False)
class FaultHypothesis:
    """A fault that may have begun.

    Attributes
    ----------
    kind : of the fault.
    joints : numbers of the joints that it concerns; empty: all.
    affected : numbers of the k joints whose residuals it changes.
    columns : (N, k, a) change of these residuals for unit values of its sizes (a,).
    fit_sizes : fits the sizes within their bounds.
    min_size : least size that is a fault; changes by less occur in sound robots.
    norm : (a, a) the size of a fault with sizes s is sqrt(s^T norm s).
    """

    kind: FaultKind
    joints: tuple[int, ...]
    affected: tuple[int, ...]
    columns: Array
    fit_sizes: SizeFit
    min_size: float = 0.0
    norm: Array | None = None

    def is_fault(self, sizes: Array) -> bool:
        """Whether one of the sizes (a,) is beyond what occurs in sound robots."""
        size = np.abs(sizes[0]) if self.norm is None else np.sqrt(sizes @ self.norm @ sizes)
        return bool(size >= self.min_size)


def fault_hypotheses(
    signals: FaultSignals, joints: tuple[Joint, ...], link_mass: float, robot_mass: float
) -> Iterator[FaultHypothesis]:
    """Yield all faults that may begin, except contacts.

    Parameters
    ----------
    signals : of n joints.
    joints : the n joints of the robot.
    link_mass : mass of the link that may carry a payload [kg]: no more than that can be missing.
    robot_mass : mass of all links that move [kg].
    """
    n = len(joints)
    everything = tuple(range(n))
    payload_fit = _fit_payload(link_mass)
    yield FaultHypothesis("payload", (), everything, signals.payload_efforts, payload_fit, MIN_PAYLOAD * robot_mass)
    yield FaultHypothesis(
        "delay", (), everything, -signals.effort_rates[..., None], _fit_between(0, MAX_DELAY), MIN_DELAY
    )
    for number, joint in enumerate(joints):
        yield _friction_hypothesis(signals, number, joint)
        effort = signals.predicted[:, [number], None]
        gain_fit = _fit_between(MIN_GAIN_CHANGE, MAX_GAIN_CHANGE)
        yield FaultHypothesis("gain", (number,), (number,), effort, gain_fit, MIN_GAIN_FAULT)
        yield FaultHypothesis("sign", (number,), (number,), -2 * effort, _fit_between(1, 1))
        offset = signals.offset_efforts[:, :, [number]]
        yield FaultHypothesis("offset", (number,), everything, offset, _fit_between(-MAX_OFFSET, MAX_OFFSET))
        for other in range(number):
            difference = signals.predicted[:, number] - signals.predicted[:, other]
            columns = np.stack([difference, -difference], axis=1)[..., None]
            pair = (other, number)
            yield FaultHypothesis("swapped", pair, pair, columns, _fit_between(1, 1))


def describe(kind: FaultKind, names: tuple[str, ...], sizes: Array, link: str) -> str:
    """A sentence on a fault of joints `names`, of some sizes (a,); link: that may carry a payload."""
    joints = " and ".join(names)
    if kind == "payload":
        return f"a payload of {sizes[0]:+.2g} kg on {link}"
    if kind == "friction":
        return f"friction of {joints} changed by {sizes[0]:+.2g} (Coulomb) and {sizes[1]:+.2g} (viscous)"
    if kind == "gain":
        return (
            f"the effort of {joints} is {1 + sizes[0]:.3g} times too large"
            if sizes[0] > 0
            else (f"the effort of {joints} is only {1 + sizes[0]:.3g} times its value")
        )
    if kind == "offset":
        return f"the position of {joints} is wrong by {sizes[0]:+.2g}"
    if kind == "delay":
        return f"efforts are {1000 * sizes[0]:.0f} ms late"
    if kind == "swapped":
        return f"efforts of {joints} are swapped"
    return f"the sign of the effort of {joints} is wrong"


def _fit_between(low: float, high: float) -> SizeFit:
    """Fits one size between two bounds."""

    def fit(squares: Array, products: Array) -> Array:
        sizes: Array = np.clip(products / squares[:, 0], low, high)
        return sizes

    return fit


def _fit_payload(link_mass: float) -> SizeFit:
    """Fits mass and first moments; where they are not those of a body near its frame, a mass at the origin."""

    def fit(squares: Array, products: Array) -> Array:
        sizes = solve_each(squares, products)
        distance = np.linalg.norm(sizes[:, 1:], axis=1)
        is_possible = (sizes[:, 0] >= -link_mass) & (distance <= MAX_PAYLOAD_DISTANCE * np.abs(sizes[:, 0]))
        point_mass = np.zeros_like(sizes)
        point_mass[:, 0] = np.maximum(products[:, 0] / squares[:, 0, 0], -link_mass)
        possible: Array = np.where(is_possible[:, None], sizes, point_mass)
        return possible

    return fit


def _friction_hypothesis(signals: FaultSignals, number: int, joint: Joint) -> FaultHypothesis:
    """Coulomb and viscous friction that both grow or both shrink, at most to zero."""
    friction = np.array([joint.coulomb_friction, joint.viscous_friction])
    columns = np.stack([signals.velocity_signs[:, [number]], signals.velocities[:, [number]]], axis=-1)

    def fit(squares: Array, products: Array) -> Array:
        both = solve_each(squares, products)
        single = products / np.diagonal(squares, axis1=1, axis2=2)
        single = np.maximum(single, -friction)
        gains = 2 * single * products - single**2 * np.diagonal(squares, axis1=1, axis2=2)
        best = np.where(gains == gains.max(axis=1, keepdims=True), single, 0)
        is_possible = (both[:, 0] * both[:, 1] >= 0) & (both >= -friction).all(axis=1)
        sizes: Array = np.where(is_possible[:, None], both, best)
        return sizes

    rows = columns[signals.valid[:, number], 0]
    norm = rows.T @ rows / max(1, len(rows))
    min_size = MIN_FRICTION_CHANGE * float(np.sqrt(friction @ norm @ friction))
    return FaultHypothesis("friction", (number,), (number,), columns, fit, min_size, norm)
