"""Legs of a parallel robot in a YAML description: chains that are written once and placed several times, as copies.

    legs:
      - joints: [...]                                  # rows; the first is placed in the base of the copy
        end: {joint: ball, type: spherical}            # joint between the last row and the platform
        copies:
          - {base: {xyz: [1, 0, 0]}, platform: {xyz: [0.5, 0, 0]}}
          - {base: {xyz: [-1, 0, 0]}, platform: {xyz: [-0.5, 0, 0]}}

Each copy becomes ordinary rows and loops, with a suffix at the names of its joints, links and loops. Where there are
several platforms, each copy names its own, platform: {antecedent: upper, ...}, and begins on the base of that platform.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.errors import describe_unknown_name
from robot_dynamics.model.formats.mdh_yaml.document import YamlPart
from robot_dynamics.model.formats.mdh_yaml.loops import LoopDescription
from robot_dynamics.model.formats.mdh_yaml.platforms import list_platforms

if TYPE_CHECKING:
    from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument, YamlMapping, YamlPath
    from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator

MAX_LEG_PARTS = 5000
"""Rows, beams and loops of all copies of legs; a platform on six legs has forty."""


class LegCopy(NamedTuple):
    """One leg, as if it were described alone.

    Attributes
    ----------
    evaluator : YamlEvaluator
        Evaluator with the parameters of the copy.
    base : YamlPart
        The frame in which its first row is placed.
    rows : list of YamlPart
        Its rows.
    loops : list of LoopDescription
        Loops within the leg, and those that close it on the platform.
    """

    evaluator: YamlEvaluator
    base: YamlPart
    rows: list[YamlPart]
    loops: list[LoopDescription]


def expand_legs(evaluator: YamlEvaluator) -> list[LegCopy]:
    """Return the copies of all legs of the document of an evaluator, in their order."""
    document = evaluator.document
    legs = document.data.get("legs", [])
    platforms = {mapping["link"]: mapping for mapping, _ in list_platforms(document)}
    if legs and not platforms:
        document.fail(("legs",), "platform missing: the link that the legs hold, platform: {link: ..., mass: ...}")
    _check_part_count(document, legs)
    copies = []
    for number, leg in enumerate(legs):
        path = ("legs", number)
        if ("end" in leg) == ("ends" in leg):
            document.fail(path, "either end is needed, or ends for a leg with several joints at the platform")
        suffixes: list[str] = []
        for place, copy in enumerate(leg["copies"]):
            copy_path = (*path, "copies", place)
            suffix = copy.get("suffix", f"_{place + 1}")
            if suffix in suffixes:
                document.fail((*copy_path, "suffix"), f"suffix {suffix!r} is already used: suffixes must be unique")
            suffixes.append(suffix)
            platform = _find_platform(document, platforms, copy.get("platform", {}), copy_path)
            copies.append(_expand_copy(evaluator, YamlPart(leg, path), YamlPart(copy, copy_path), suffix, platform))
    return copies


def _check_part_count(document: YamlDocument, legs: Sequence[YamlMapping]) -> None:
    """Raise DescriptionError where a short text describes very many parts, as copies of legs."""
    total = 0
    for number, leg in enumerate(legs):
        rows = leg["joints"]
        parts = len(rows) + sum(len(row.get("beams", [])) for row in rows) + len(leg.get("loops", []))
        total += (parts + len(leg.get("ends", [0]))) * len(leg["copies"])
        if total > MAX_LEG_PARTS:
            document.fail(
                ("legs", number, "copies"),
                f"the copies of the legs up to here have {total} rows, beams and loops: the maximum is {MAX_LEG_PARTS}",
            )


def _find_platform(
    document: YamlDocument, platforms: dict[str, YamlMapping], mapping: YamlMapping, path: YamlPath
) -> YamlMapping:
    """Return the mapping of the platform that the mapping `platform` of the copy at a path names."""
    if "antecedent" not in mapping and len(platforms) > 1:
        names = ", ".join(platforms)
        document.fail(path, f"there are several platforms ({names}): name one of them, platform: {{antecedent: ...}}")
    name = mapping.get("antecedent", next(iter(platforms)))
    if name not in platforms:
        document.fail((*path, "platform", "antecedent"), describe_unknown_name("platform", name, platforms))
    return platforms[name]


def _expand_copy(
    evaluator: YamlEvaluator, leg: YamlPart, copy: YamlPart, suffix: str, platform: YamlMapping
) -> LegCopy:
    """Return a copy of a leg that holds a platform."""
    evaluator = evaluator.with_values(copy.mapping.get("parameters", {}), (*copy.path, "parameters"))
    renamer = _Renamer(leg.mapping, suffix)
    rows = [
        YamlPart(renamer.rename_row(row), (*leg.path, "joints", number))
        for number, row in enumerate(leg.mapping["joints"])
    ]
    loops = []
    for number, loop in enumerate(leg.mapping.get("loops", [])):
        path = (*leg.path, "loops", number)
        moved = YamlPart(renamer.rename_antecedent(loop["moved"]), (*path, "moved"))
        closed_on = YamlPart(renamer.rename_antecedent(loop["closed_on"]), (*path, "closed_on"))
        loops.append(LoopDescription(renamer.rename_joint(loop), path, evaluator, (moved,), (closed_on,)))
    last_link = rows[-1].mapping["link"]
    on_platform = YamlPart(
        {"antecedent": platform["link"], **copy.mapping.get("platform", {})}, (*copy.path, "platform")
    )
    for end, path in _leg_ends(leg):
        moved_mapping = {"antecedent": last_link, **renamer.rename_antecedent(end.get("moved", {}))}
        moved = YamlPart(moved_mapping, (*path, "moved"))
        closed_on = YamlPart(end.get("closed_on", {}), (*path, "closed_on"))
        description = LoopDescription(renamer.rename_joint(end), path, evaluator, (moved,), (on_platform, closed_on))
        loops.append(description)
    default_base = {"antecedent": platform["base"]} if "base" in platform else {}
    base = YamlPart({**default_base, **copy.mapping.get("base", {})}, (*copy.path, "base"))
    return LegCopy(evaluator, base, rows, loops)


def _leg_ends(leg: YamlPart) -> list[YamlPart]:
    """Return the joints between a leg and its platform."""
    if "end" in leg.mapping:
        return [YamlPart(leg.mapping["end"], (*leg.path, "end"))]
    return [YamlPart(end, (*leg.path, "ends", number)) for number, end in enumerate(leg.mapping["ends"])]


class _Renamer:
    """Adds the suffix of a copy to the names that a leg defines, and to no others."""

    def __init__(self, leg: YamlMapping, suffix: str) -> None:
        self._suffix = suffix
        ends = [end.mapping for end in _leg_ends(YamlPart(leg, ()))]
        mappings = [*leg["joints"], *leg.get("loops", []), *ends]
        self._links = {mapping["link"] for mapping in mappings if "link" in mapping}
        self._joints = {mapping["joint"] for mapping in mappings if "joint" in mapping}

    def rename_row(self, row: YamlMapping) -> YamlMapping:
        """Return a row with new names."""
        row = self.rename_antecedent(self.rename_joint(row))
        if "mimic" in row and row["mimic"]["joint"] in self._joints:
            row["mimic"] = {**row["mimic"], "joint": row["mimic"]["joint"] + self._suffix}
        return row

    def rename_joint(self, mapping: YamlMapping) -> YamlMapping:
        """Return a mapping with new names of the joint and of the link that it moves."""
        names: YamlMapping = {key: mapping[key] + self._suffix for key in ("joint", "link") if key in mapping}
        return {**mapping, **names}

    def rename_antecedent(self, mapping: YamlMapping) -> YamlMapping:
        """Return a mapping with a new name of the antecedent, where that is a link of the leg."""
        if mapping.get("antecedent") not in self._links:
            return mapping
        return {**mapping, "antecedent": mapping["antecedent"] + self._suffix}
