"""Requests of the services of dynamics_server, by the functions that the node calls.

An input is JSON: {"service": ..., "robot": ..., "request": fields}. A request is refused with a RobotDynamicsError, or
its response has finite numbers. For the Panda, Pinocchio computes the same efforts.
"""

from __future__ import annotations

import json
import random
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from fuzzing.campaign import Outcome, read_corpus
from fuzzing.message_mutations import fill_message, mutate_tree
from rclpy.serialization import deserialize_message, serialize_message

from robot_dynamics import Dynamics, RobotDynamicsError, load_robot
from robot_dynamics.model.loading import shipped_robots
from robot_dynamics.nodes.dynamics_server.node import SERVICES
from robot_dynamics.nodes.dynamics_server.point_work import require_point_count

try:
    import pinocchio as pin
except ImportError:
    pin = None

MOST_ATTEMPTS = 20  # until a mutated request is one that a client can send
MOST_POINTS = 100_000  # the default of max_points
COMPARED_POINTS = 3
LARGEST_VALUE = 1e4  # of states that are compared: rounding errors of others are large
TOLERANCE = 1e-8  # relative to the largest effort of terms


class RequestTarget:
    """Requests of all services."""

    name = "requests"

    def __init__(self) -> None:
        self._robots: dict[str, Dynamics] = {}
        self._services = {name: (kind, handle) for kind, name, handle in SERVICES}
        self._peer = None

    def prepare(self) -> None:
        """Load the robots, and use them once."""
        for data in read_corpus(Path(__file__).parents[1] / "corpus" / self.name):
            self.run(data)

    def mutate(self, data: bytes, rng: random.Random, corpus: list[bytes]) -> bytes:
        """Return a request with other fields, rarely for another service or robot, that a client can send."""
        for _ in range(MOST_ATTEMPTS):
            content = json.loads(data)
            if rng.random() < 0.05:
                key = rng.choice(["service", "robot"])
                content[key] = json.loads(rng.choice(corpus))[key]
            content["request"] = mutate_tree(content["request"], rng)
            try:
                self._message(content)
            except ValueError:
                continue
            return json.dumps(content).encode()
        return data

    def run(self, data: bytes) -> Outcome:
        """Carry out a request."""
        content = json.loads(data)
        kind, handle = self._services[content["service"]]
        dynamics = self._dynamics(content["robot"])
        try:
            request = self._message(content)
        except ValueError:
            return Outcome("no message")
        request = deserialize_message(serialize_message(request), kind.Request)  # as a node receives it
        response = kind.Response()
        try:
            work = handle(request, response, dynamics, "/")
            if work is not None:
                require_point_count(work, MOST_POINTS)
                start, size = 0, work.first_range
                while start < work.count:
                    work.compute(slice(start, min(work.count, start + size)))
                    start += size
                    size *= 4
                work.finish()
        except RobotDynamicsError as error:
            text = str(error)
            assert len(text) < 3000 and "\x1b" not in text, text[:300]
            return Outcome(
                "refused", f"{content['service']} {content['robot']} " + re.sub(r"'[^']*'|[-\d.e+]+", "", text)[:60]
            )
        assert response.success
        require_finite(response)
        compared = 0
        if content["robot"] == "panda" and pin is not None:
            self._peer = self._peer or PandaPeer()
            compared = self._peer.compare(content["service"], request, response)
        return Outcome("compared" if compared else "accepted", content["service"] + content["robot"], compared)

    def _message(self, content: Mapping[str, Any]) -> Any:
        """The request. Raises ValueError where it is none of its service."""
        kind, _ = self._services[content["service"]]
        return fill_message(kind.Request(), content["request"])

    def _dynamics(self, name: str) -> Dynamics:
        if name not in self._robots:
            self._robots[name] = Dynamics(load_robot(name), compiled=False)
        return self._robots[name]


def require_finite(message: Any) -> None:
    """Raise AssertionError where a message has a number that is not finite."""
    if isinstance(message, float):
        assert np.isfinite(message), "the response has a number that is not finite"
    elif hasattr(message, "typecode") or isinstance(message, np.ndarray):
        assert np.isfinite(message).all(), "the response has a number that is not finite"
    elif hasattr(message, "get_fields_and_field_types"):
        for name in message.get_fields_and_field_types():
            require_finite(getattr(message, name))
    elif isinstance(message, list | tuple):
        for item in message[:1000]:
            require_finite(item)


class PandaPeer:
    """The shipped Panda in Pinocchio."""

    def __init__(self) -> None:
        self.model = pin.buildModelFromXML(shipped_robots()["panda"].read_text())
        self.data = self.model.createData()

    def rows(self, names) -> list[int]:
        """Rows in Pinocchio of joints by their names, which may have the namespace of the node."""
        rows = [self.model.joints[self.model.getJointId(name.removeprefix("/"))].idx_v for name in names]
        assert sorted(rows) == list(range(self.model.nv)), f"joints {list(names)[:10]}"
        return rows

    def vector(self, rows, values):
        """Values in the order of Pinocchio."""
        full = np.zeros(self.model.nv)
        full[rows] = values
        return full

    def compare(self, service: str, request: Any, response: Any) -> int:
        """Compare the response of a service; returns the number of points that agree."""
        batch = service.endswith("_batch")
        if service.startswith(("inverse", "direct")):
            if request.external_wrenches:
                return 0
            points = (
                self._flat_points(service, request, response) if batch else self._points(service, request, response)
            )
            return sum(self._same_motion(*point) for point in points[:COMPARED_POINTS])
        if service == "dynamics_terms":
            rows = self.rows(request.joint_names)
            state = request.state
            return self._same_terms(rows, np.array(state.positions), np.array(state.velocities), response)
        if service == "static_equilibrium" and not request.external_wrenches:
            rows = self.rows(request.trajectory.joint_names)
            pairs = list(zip(request.trajectory.points, response.trajectory.points, strict=True))[:COMPARED_POINTS]
            zeros = np.zeros(self.model.nv)
            return sum(self._same_motion(rows, ask.positions, zeros, zeros, reply.effort) for ask, reply in pairs)
        return 0

    def _points(self, service: str, request: Any, response: Any) -> list:
        rows = self.rows(request.trajectory.joint_names)
        assert list(response.trajectory.joint_names) == list(request.trajectory.joint_names)
        pairs = zip(request.trajectory.points, response.trajectory.points, strict=True)
        if service == "inverse_dynamics":
            return [(rows, a.positions, a.velocities, a.accelerations, b.effort) for a, b in pairs]
        return [(rows, a.positions, a.velocities, b.accelerations, a.effort) for a, b in pairs]

    def _flat_points(self, service: str, request: Any, response: Any) -> list:
        count = request.count
        if count == 0:
            return []
        rows = self.rows(request.joint_names or response.joint_names)

        def field(values):
            values = np.asarray(values)
            return np.broadcast_to(
                values if values.size == len(rows) else values.reshape(count, -1), (count, len(rows))
            )

        q, qd = field(request.positions), field(request.velocities)
        if service.startswith("inverse"):
            qdd, efforts = field(request.accelerations), field(response.efforts)
        else:
            qdd, efforts = field(response.accelerations), field(request.efforts)
        return [(rows, *states) for states in zip(q, qd, qdd, efforts, strict=True)]

    def _same_motion(self, rows, q, qd, qdd, efforts) -> int:
        q, qd, qdd = (self.vector(rows, values) for values in (q, qd, qdd))
        if max(np.abs(q).max(), np.abs(qd).max()) > LARGEST_VALUE:
            return 0
        expected = pin.rnea(self.model, self.data, q, qd, qdd)
        scale = 1.0 + np.abs(expected).max() + np.abs(qdd).max() + np.abs(qd).max() ** 2
        error = np.abs(self.vector(rows, efforts) - expected).max()
        assert error <= TOLERANCE * scale, f"differs from Pinocchio by {error:.3g}"
        return 1

    def _same_terms(self, rows, q, qd, response: Any) -> int:
        q, qd = self.vector(rows, q), self.vector(rows, qd)
        if max(np.abs(q).max(), np.abs(qd).max()) > LARGEST_VALUE:
            return 0
        upper = np.triu(pin.crba(self.model, self.data, q))
        matrix = upper + np.triu(upper, 1).T
        gravity = pin.computeGeneralizedGravity(self.model, self.data, q).copy()
        bias = pin.nonLinearEffects(self.model, self.data, q, qd)
        size = len(rows)
        served = np.zeros((size, size))
        served[np.ix_(rows, rows)] = np.reshape(response.inertia_matrix, (size, size))
        scale = 1.0 + np.abs(bias).max()
        for values, expected in (
            (served, matrix),
            (self.vector(rows, response.gravity), gravity),
            (self.vector(rows, response.coriolis) + gravity, bias),
        ):
            assert np.abs(values - expected).max() <= TOLERANCE * scale, "terms differ from Pinocchio"
        return 1
