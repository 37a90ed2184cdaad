"""Robots of descriptions in Pinocchio, read without this project: URDF by Pinocchio, MDH tables and .par by this file.

The readers here cover rigid trees on a fixed base. They raise `NotCovered` for everything else, which is not compared.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

FUNCTIONS = {name: getattr(math, name) for name in "sin cos tan asin acos atan atan2 sqrt radians degrees exp".split()}
CONSTANTS = {"pi": math.pi, "Pi": math.pi}
NUMBER = re.compile(r"(?<![\w.])(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
INERTIA_KEYS = ("xx", "xy", "xz", "yy", "yz", "zz")
BODY_KEYS = {"mass", "first_moments", "inertia", "centre_of_mass", "central_inertia"}
ROW_KEYS = {"joint", "link", "antecedent", "type", "mdh", "named", "role", "spring", "limits", "rotor_inertia"}
ROW_KEYS |= {"viscous_friction", "coulomb_friction", "initial_position"}
NODES = (ast.Expression, ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Load, ast.Constant)
NODES += (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.USub, ast.UAdd)


class NotCovered(Exception):
    """This reader cannot read a description, or Pinocchio cannot."""


@dataclass
class Tree:
    """A robot in Pinocchio. rows: {joint: row of vectors}; rotors: {joint: inertia}."""

    model: pin.Model
    rows: dict[str, int] = field(default_factory=dict)

    def efforts(self, q, qd, qdd) -> Any:
        """Efforts (n,) without friction, all vectors in the order of `rows`."""
        return pin.rnea(self.model, self.model.createData(), q, qd, qdd)


def value_of(text: object, names: Mapping[str, float]) -> float:
    """The number of an expression; `^` is the power."""
    if not isinstance(text, str) or len(text) > 200 or not re.fullmatch(r"[\w.+\-*/^(), ]+", text, re.ASCII):
        raise NotCovered(f"{text!r}")
    try:
        tree = ast.parse(NUMBER.sub(lambda match: repr(float(match[0])), text).replace("^", "**").strip(), mode="eval")
        for node in ast.walk(tree):
            if not isinstance(node, NODES):
                raise NotCovered(text)
        value = eval(compile(tree, "text", "eval"), {"__builtins__": {}}, {**FUNCTIONS, **CONSTANTS, **names})
    except NotCovered:
        raise
    except Exception as error:
        raise NotCovered(f"{text!r}: {error}") from None
    if not isinstance(value, float) or not math.isfinite(value):
        raise NotCovered(text)
    return value


class TreeBuilder:
    """Appends MDH rows to a model."""

    def __init__(self, base: str, gravity) -> None:
        self.tree = Tree(pin.Model())
        self.tree.model.gravity.linear = np.array(gravity)
        self._parents = {base: (0, pin.SE3.Identity())}

    def add(self, antecedent, link, joint, kind, placement, rotor=0.0) -> None:
        """Append a row: placement is (gamma, b, alpha, d, theta, r)."""
        if antecedent not in self._parents or link in self._parents or joint in self.tree.rows:
            raise NotCovered(f"{antecedent!r}, {link!r}, {joint!r}")
        parent, offset = self._parents[antecedent]
        placed = offset * mdh_placement(*placement)
        if kind == "fixed":
            self._parents[link] = (parent, placed)
            return
        model = pin.JointModelRZ() if kind == "revolute" else pin.JointModelPZ()
        number = self.tree.model.addJoint(parent, model, placed, joint)
        self.tree.rows[joint] = self.tree.model.joints[number].idx_v
        self.tree.model.armature[self.tree.rows[joint]] = rotor
        self._parents[link] = (number, pin.SE3.Identity())

    def add_body(self, link, mass, first_moments, inertia) -> None:
        """Append a body: inertia (3, 3) about the origin of the frame."""
        parent, placed = self._parents[link]
        if mass == 0.0 and np.any(first_moments):
            raise NotCovered("first moments without mass")
        cross = pin.skew(first_moments / mass) if mass else np.zeros((3, 3))
        try:
            body = pin.Inertia(mass, first_moments / (mass or 1.0), inertia + mass * cross @ cross)
        except RuntimeError as error:  # of an inertia that no body can have
            raise NotCovered(str(error)) from None
        self.tree.model.appendBodyToJoint(parent, body, placed)


def mdh_placement(gamma, b, alpha, d, theta, r) -> pin.SE3:
    """Rot(z, gamma) Trans(z, b) Rot(x, alpha) Trans(x, d) Rot(z, theta) Trans(z, r)."""

    def turn(axis, angle, distance):
        vector = np.zeros(3)
        vector[axis] = 1.0
        return pin.SE3(pin.utils.rotate("xyz"[axis], angle), distance * vector)

    return turn(2, gamma, b) * turn(0, alpha, d) * turn(2, theta, r)


def matrix_of(values: Mapping[str, float]):
    """A symmetric matrix from its elements by name."""
    xx, xy, xz, yy, yz, zz = (values.get(key, 0.0) for key in INERTIA_KEYS)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def read_urdf_tree(text: str) -> Tree:
    """The robot of a URDF by Pinocchio."""
    if "<mimic" in text or re.search(r"type\s*=\s*.(floating|planar|spherical)", text):
        raise NotCovered("mimic joints and joints with several axes")
    try:
        model = pin.buildModelFromXML(text)
    except Exception as error:
        raise NotCovered(f"Pinocchio: {error}") from None
    rows = {}
    for number in range(1, model.njoints):  # line breaks and tabs in attributes are spaces in XML, not in Pinocchio
        rows[re.sub(r"\r\n|[\r\n\t]", " ", model.names[number])] = model.joints[number].idx_v
    return Tree(model, rows)


def read_table_tree(text: str) -> Tree:
    """The robot of an MDH table."""
    try:
        document = yaml.load(text, yaml.BaseLoader)  # all numbers stay texts
    except Exception as error:
        raise NotCovered(str(error)) from None
    allowed = {"robot", "parameters", "gravity", "base", "joints", "frames", "source", "format"}
    if not isinstance(document, dict) or set(document) - allowed:
        raise NotCovered("keys of the document")
    try:
        return _read_table(document)
    except (AttributeError, TypeError, KeyError, ValueError) as error:
        raise NotCovered(repr(error)) from None


def _read_table(document: Mapping[str, Any]) -> Tree:
    names: dict[str, float] = {}
    for name, text in (document.get("parameters") or {}).items():
        names[name] = value_of(text, names)

    def vector(values):
        if len(values) != 3:
            raise NotCovered(str(values))
        return np.array([value_of(value, names) for value in values])

    def matrix(values):
        if set(values) - set(INERTIA_KEYS):
            raise NotCovered(str(values))
        return matrix_of({key: value_of(value, names) for key, value in values.items()})

    base = document.get("base") or {}
    if base.get("moving", "false") != "false":
        raise NotCovered("a moving base")
    gravity = vector(document["gravity"]) if "gravity" in document else (0.0, 0.0, -9.81)
    builder = TreeBuilder(base.get("link", "base_link"), gravity)
    previous = base.get("link", "base_link")
    for row in document["joints"]:
        if set(row) - ROW_KEYS - BODY_KEYS:
            raise NotCovered(str(sorted(set(row) - ROW_KEYS - BODY_KEYS)))
        kind = row.get("type", "revolute")
        mdh = row.get("mdh") or {}
        keys = ("gamma", "b", "alpha", "d", "theta", "r")
        if set(mdh) - set(keys) or kind not in ("revolute", "prismatic", "fixed"):
            raise NotCovered(str(mdh))
        placement = [value_of(mdh.get(key, "0"), names) for key in keys]
        rotor = value_of(row.get("rotor_inertia", "0"), names)
        builder.add(row.get("antecedent", previous), row["link"], row.get("joint"), kind, placement, rotor)
        mass = value_of(row.get("mass", "0"), names)
        if "centre_of_mass" in row or "central_inertia" in row:
            centre = vector(row.get("centre_of_mass", "000"))
            cross = pin.skew(centre)
            inertia = matrix(row.get("central_inertia") or {}) - mass * cross @ cross
            builder.add_body(row["link"], mass, mass * centre, inertia)
        else:
            builder.add_body(
                row["link"], mass, vector(row.get("first_moments", "000")), matrix(row.get("inertia") or {})
            )
        previous = row["link"]
    return builder.tree


def read_par_tree(text: str) -> Tree:
    """The robot of a SYMORO+ .par."""
    text = re.sub(r"\(\*.*?\*\)", " ", text, flags=re.DOTALL)
    lists: dict[str, list[str]] = {}
    position = 0
    pattern = re.compile(r"\s*(\w+)\s*=\s*(\{[^{}]*\}|[^\s{}=]+)", re.ASCII)
    while text[position:].strip():
        match = pattern.match(text, position)
        if match is None or match[1].lower() in lists:
            raise NotCovered(text[position : position + 30])
        content = match[2].strip("{}")
        lists[match[1].lower()] = [entry.strip() for entry in content.split(",")] if content.strip() else []
        position = match.end()
    try:
        return _read_par(lists)
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise NotCovered(repr(error)) from None


def _read_par(lists: Mapping[str, list[str]]) -> Tree:
    number_of_frames = int(lists["nf"][0])
    for key in ("is_floating", "is_mobile", "type"):
        if lists.get(key, ["0"])[0] not in ("0", "False"):
            raise NotCovered(key)
    if not int(lists["nl"][0]) == int(lists["nj"][0]) == number_of_frames:
        raise NotCovered("loops")

    def entry(key: str, k: int) -> str:
        values = lists.get(key, ["0"] * number_of_frames)
        if len(values) != number_of_frames:
            raise NotCovered(key)
        return values[k]

    def number(key: str, k: int, variable: str | None = None) -> float:
        return value_of(entry(key, k), {} if variable is None else {variable: 0.0})

    gravity = [value_of(text, {}) for text in lists.get("g", [])]
    if len(gravity) != 3:
        raise NotCovered("gravity")
    builder = TreeBuilder("0", gravity)
    for k in range(number_of_frames):
        kind = {0: "revolute", 1: "prismatic", 2: "fixed"}.get(int(entry("sigma", k)))
        if kind is None:
            raise NotCovered("sigma")
        placement = []
        for key in ("gamma", "b", "alpha", "d", "theta", "r"):
            text = entry(key, k)
            names = [
                name for name in re.findall(r"[A-Za-z_]\w*", NUMBER.sub("0", text)) if name not in CONSTANTS | FUNCTIONS
            ]
            is_variable = (kind, key) in (("revolute", "theta"), ("prismatic", "r")) and len(names) == 1
            if is_variable and text.startswith("-"):
                raise NotCovered(text)
            placement.append(number(key, k, names[0] if is_variable else None))
        builder.add(entry("ant", k), str(k + 1), str(k + 1), kind, placement, number("ia", k))
        elements = {key: number(key, k) for key in INERTIA_KEYS}
        moments = np.array([number(key, k) for key in ("mx", "my", "mz")])
        builder.add_body(str(k + 1), number("m", k), moments, matrix_of(elements))
    return builder.tree
