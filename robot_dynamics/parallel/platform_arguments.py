"""Checks of the arguments of PlatformDynamics, and its results by platform."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.array_types import Array, ArrayLike
from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.inputs import require_pose

PlatformInput: TypeAlias = ArrayLike | Mapping[str, ArrayLike]
"""Values of one platform, or of several by link name."""

PlatformArray: TypeAlias = Array | dict[str, Array]
"""An array of one platform, or arrays of several by link name."""

OtherJointInput: TypeAlias = Sequence[ArrayLike | None]
"""Positions, velocities and accelerations (..., k) of the joints that no platform determines, or the first of these."""

TWIST_COMPONENTS = "linear and angular components"


class OtherJointMotion(NamedTuple):
    """Motion (..., k) of the joints that no platform determines; positions None: from the seed or the description."""

    positions: Array | None
    velocities: Array
    accelerations: Array


@dataclass(frozen=True)
class PlatformArguments:
    """Arguments of PlatformDynamics.

    link_names: of the platforms; other_joint_names: of the k joints that no platform determines;
    ignored_accelerations: {column: reason} of those of these k joints whose acceleration is a result.
    """

    link_names: tuple[str, ...]
    other_joint_names: tuple[str, ...]
    ignored_accelerations: Mapping[int, str]

    def check_poses(self, pose: PlatformInput) -> Array:
        """Return checked poses (..., platforms, 4, 4)."""
        poses = self._by_link("pose", pose)
        missing = [link for link in self.link_names if link not in poses]
        if missing:
            raise InvalidInputError(
                f"pose of platform {', '.join(map(repr, missing))} missing: each platform needs one"
            )
        return _stack([require_pose(poses[link], self._label("pose", link)) for link in self.link_names], 2)

    def check_screws(self, label: str, values: PlatformInput | None) -> Array:
        """Return checked twists or accelerations (..., platforms, 6), zero where there are none."""
        screws = {} if values is None else self._by_link(label, values)
        return _stack(
            [
                require_finite(self._label(label, link), screws.get(link, np.zeros(6)), 6, TWIST_COMPONENTS)
                for link in self.link_names
            ],
            1,
        )

    def check_other_joints(self, other_joints: OtherJointInput | None) -> OtherJointMotion:
        """Return the checked motion of the other joints, velocities and accelerations zero by default."""
        values = [] if other_joints is None else [*other_joints]
        positions, velocities, accelerations, *_ = [*values, None, None, None]
        rest = np.zeros(len(self.other_joint_names))
        return OtherJointMotion(
            None if positions is None else self._check_others("positions", positions),
            rest if velocities is None else self._check_others("velocities", velocities),
            rest
            if accelerations is None
            else self._check_others("accelerations", accelerations, self.ignored_accelerations),
        )

    def _check_others(self, label: str, values: ArrayLike, ignored: Mapping[int, str] | None = None) -> Array:
        names = f"joints ({', '.join(self.other_joint_names)})"
        return require_finite(f"{label} of other joints", values, len(self.other_joint_names), names, ignored)

    def by_platform(self, values: Array, axes: int = 1) -> PlatformArray:
        """Return the array (..., *axes) of the only platform, or {link name: array}, of (..., platforms, *axes)."""
        rows = np.moveaxis(values, -1 - axes, 0)
        return rows[0] if self._is_single else dict(zip(self.link_names, rows, strict=True))

    @property
    def _is_single(self) -> bool:
        return len(self.link_names) == 1

    def _by_link(self, label: str, values: PlatformInput) -> Mapping[str, ArrayLike]:
        if self._is_single:
            return {self.link_names[0]: values}  # type: ignore[dict-item]  # require_finite refuses a mapping
        if not isinstance(values, Mapping):
            raise InvalidInputError(
                f"{label} of platforms {', '.join(self.link_names)}: a mapping by these names is needed"
            )
        for link in values:
            if link not in self.link_names:
                raise InvalidInputError(f"{label}: {describe_unknown_name('platform', link, self.link_names)}")
        return values

    def _label(self, label: str, link: str) -> str:
        return f"{label} of the platform" if self._is_single else f"{label} of platform {link!r}"


def _stack(arrays: Sequence[Array], axes: int) -> Array:
    """Return arrays (..., *axes), one for each platform, as one array (..., platforms, *axes)."""
    batch = np.broadcast_shapes(*(array.shape[: array.ndim - axes] for array in arrays))
    rows = [np.broadcast_to(array, (*batch, *array.shape[array.ndim - axes :])) for array in arrays]
    return np.stack(rows, axis=-1 - axes)
