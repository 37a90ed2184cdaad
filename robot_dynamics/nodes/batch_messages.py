"""Requests and responses of the services with flat arrays as NumPy arrays, for clients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.fields import to_float_array

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike

ITEM_SHAPES = {"inertia_matrix": None, "reactions": (-1, 6)}
"""Shape of the values of a point in fields that are no rows; None: square."""


@dataclass(frozen=True, eq=False)
class BatchResult:
    """Response of a service with flat arrays; `result["efforts"]` is an array with one row for each point.

    Attributes
    ----------
    joint_names : columns of the fields of joints, and of the terms.
    fields : arrays by the name of the field, (N, columns); inertia_matrix (N, n, n), reactions (N, links, 6). Fields
        that were not requested are not there.
    warning : message of the response, empty for most robots.
    response : the message itself, of the first request if there were several; it also names links.
    """

    joint_names: tuple[str, ...]
    fields: dict[str, Array]
    warning: str
    response: Any

    def __getitem__(self, field: str) -> Array:
        return self.fields[field]


def make_batch_requests(
    kind: type,
    joint_names: Sequence[str],
    external_wrenches: Mapping[str, ArrayLike] | None,
    fields: Mapping[str, Any],
    points_per_request: int,
) -> list[Any]:
    """Return requests of a service with flat arrays, for successive ranges of points.

    Parameters
    ----------
    kind : type of the service.
    joint_names : columns of positions, velocities and so on.
    external_wrenches : {link: (N, 6), or (6,) that acts at every point}.
    fields : values by the name of the field: (N, columns), or (columns,) that hold at every point; truth values and
        names as the service has them.
    points_per_request : largest number of points in a request.

    Raises
    ------
    InvalidInputError
        Fields have different numbers of points, or the service has no such field.
    """
    types = kind.Request.get_fields_and_field_types()  # type: ignore[attr-defined]
    unknown = [name for name in fields if name not in types or name == "count"]
    if unknown:
        raise InvalidInputError(f"{kind.__name__} has no field {unknown[0]!r}: it has {', '.join(types)}")
    rows = {
        name: np.asarray(values, dtype=float) for name, values in fields.items() if types[name] == "sequence<double>"
    }
    wrenches = {link: np.asarray(wrench, dtype=float) for link, wrench in (external_wrenches or {}).items()}
    count = _point_count({**rows, **{f"wrench on {link!r}": wrench for link, wrench in wrenches.items()}})
    if wrenches:
        shape = (6,) if all(wrench.ndim == 1 for wrench in wrenches.values()) else (count, 6)
        links = [np.broadcast_to(wrench, shape) for wrench in wrenches.values()]
        rows["external_wrenches"] = np.concatenate(links, axis=-1)
    others = {name: values for name, values in fields.items() if name not in rows}
    requests = []
    for start in range(0, count, points_per_request):
        stop = min(count, start + points_per_request)
        request: Any = kind.Request(count=stop - start, joint_names=list(joint_names), **others)  # type: ignore[attr-defined]
        if wrenches:
            request.wrench_links = list(wrenches)
        for name, array in rows.items():
            is_of_points = array.ndim == 2 and len(array) == count
            setattr(request, name, to_float_array(array[start:stop] if is_of_points else array))
        requests.append(request)
    return requests


def read_batch_responses(responses: Sequence[Any], counts: Sequence[int]) -> BatchResult:
    """Return the fields of the responses for successive ranges of `counts` points as arrays."""
    ranges = [_read_fields(response, count) for response, count in zip(responses, counts, strict=True)]
    first = responses[0]
    fields = ranges[0]
    if len(ranges) > 1:
        fields = {name: np.concatenate([each[name] for each in ranges]) for name in fields}
    return BatchResult(tuple(first.joint_names), fields, first.message, first)


def _read_fields(response: Any, count: int) -> dict[str, Array]:
    """Return the fields of a response for `count` points as arrays that share its memory."""
    fields: dict[str, Array] = {}
    for name, kind in response.get_fields_and_field_types().items():
        values = getattr(response, name)
        if kind == "sequence<double>" and len(values):
            array = np.asarray(values)
            size = len(array) // count
            side = round(size**0.5)
            item = ITEM_SHAPES.get(name, (size,)) or (side, side)
            fields[name] = array.reshape(count, *item)
    return fields


def _point_count(arrays: Mapping[str, Array]) -> int:
    """Return the number of points of arrays (N, columns) or (columns,). Raises InvalidInputError if they differ."""
    counts = {name: len(array) for name, array in arrays.items() if array.ndim == 2}
    unusual = next((name for name, array in arrays.items() if array.ndim not in (1, 2)), None)
    if unusual is not None:
        raise InvalidInputError(
            f"{unusual} has shape {arrays[unusual].shape}: (N, columns) is needed, or (columns,) for every point"
        )
    if len(set(counts.values()) - {1}) > 1:
        raise InvalidInputError(
            f"numbers of points differ: {', '.join(f'{name} has {n}' for name, n in counts.items())}. Give one row for "
            "each point, or a single row that holds at every point"
        )
    return max(counts.values(), default=1)
