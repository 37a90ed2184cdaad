"""The legs of a parallel robot in a YAML description: chains that are written once and stand there in copies.

    legs:
      - joints: [...]                                  # rows; the first hangs on the base of the copy
        end: {joint: ball, type: spherical}            # how the last row meets the platform
        copies:
          - {base: {xyz: [1, 0, 0]}, platform: {xyz: [0.5, 0, 0]}}
          - {base: {xyz: [-1, 0, 0]}, platform: {xyz: [-0.5, 0, 0]}}

Each copy becomes rows and loops as others are, with a suffix to the names of its joints, links and loops. Where there
are many platforms, each copy says which one it meets, platform: {antecedent: upper, ...}, and begins on what that one
stands on.
"""

from typing import NamedTuple

from robot_dynamics.errors import describe_unknown_name
from robot_dynamics.model.formats.mdh_yaml.loops import LoopDescription
from robot_dynamics.model.formats.mdh_yaml.platforms import list_platforms


class LegCopy(NamedTuple):
    """One leg, told as if it stood there alone.

    numbers: YamlNumbers that know the copy's own parameters; base: (mapping, path) of the frame that its first row
    hangs on; rows: (mapping, path) of each row; loops: ToldLoops within it, and those by which it meets the platform.
    """

    evaluator: object
    base: tuple
    rows: list
    loops: list


def expand_legs(evaluator):
    """The LegCopies of the document of YamlNumbers, in their order; it may have none. Raises DescriptionError."""
    document = evaluator.document
    legs, platforms = document.data.get("legs", []), {told["link"]: told for told, _ in list_platforms(document)}
    if legs and not platforms:
        document.fail(("legs",), "platform missing: the link that the legs meet, platform: {link: ..., mass: ...}")
    found = []
    for number, leg in enumerate(legs):
        path = ("legs", number)
        if ("end" in leg) == ("ends" in leg):
            document.fail(path, "how the leg meets the platform is told once: by end, or by ends where it is in many")
        suffixes = []
        for place, told in enumerate(leg["copies"]):
            suffixes.append(told.get("suffix", f"_{place + 1}"))
            if suffixes[-1] in suffixes[:-1]:
                here = (*path, "copies", place, "suffix")
                document.fail(here, f"suffix {suffixes[-1]!r} is there already: suffixes of copies must differ")
            met = _met(document, platforms, told.get("platform", {}), (*path, "copies", place))
            found.append(_copy(evaluator, leg, path, place, suffixes[-1], platforms[met]))
    return found


def _met(document, platforms, told, path):
    """The link of the platform that a copy meets, where `told` places its end."""
    if "antecedent" not in told and len(platforms) > 1:
        names = ", ".join(platforms)
        document.fail(
            path, f"there are many platforms ({names}): platform: {{antecedent: ...}} says which the leg meets"
        )
    name = told.get("antecedent", next(iter(platforms)))
    if name not in platforms:
        document.fail((*path, "platform", "antecedent"), describe_unknown_name("platform", name, platforms))
    return name


def _copy(evaluator, leg, path, place, suffix, platform):
    told, at = leg["copies"][place], (*path, "copies", place)
    evaluator = evaluator.with_values(told.get("parameters", {}), (*at, "parameters"))
    rename = _Renamed(leg, suffix)
    rows = [(rename.row(row), (*path, "joints", k)) for k, row in enumerate(leg["joints"])]
    loops = []
    for number, loop in enumerate(leg.get("loops", [])):
        here = (*path, "loops", number)
        ends = (((rename.placed(loop[key]), (*here, key)),) for key in ("moved", "closed_on"))
        loops.append(LoopDescription(rename.named(loop), here, evaluator, *ends))
    last = rows[-1][0]["link"]
    met = {"antecedent": platform["link"], **told.get("platform", {})}, (*at, "platform")
    for end, here in _ends(leg, path):
        moved = {"antecedent": last, **rename.placed(end.get("moved", {}))}, (*here, "moved")
        closed_on = end.get("closed_on", {}), (*here, "closed_on")
        loops.append(LoopDescription(rename.named(end), here, evaluator, (moved,), (met, closed_on)))
    stands = {"antecedent": platform["base"]} if "base" in platform else {}
    return LegCopy(evaluator, ({**stands, **told.get("base", {})}, (*at, "base")), rows, loops)


def _ends(leg, path):
    """(mapping, path) of each end of a leg."""
    if "end" in leg:
        return [(leg["end"], (*path, "end"))]
    return [(end, (*path, "ends", number)) for number, end in enumerate(leg["ends"])]


class _Renamed:
    """Mappings of a leg with the suffix of a copy at the names that the leg gives, and no other."""

    def __init__(self, leg, suffix):
        self.suffix = suffix
        told = [*leg["joints"], *leg.get("loops", []), *(end for end, _ in _ends(leg, ()))]
        self.links, self.joints = ({one[key] for one in told if key in one} for key in ("link", "joint"))

    def row(self, row):
        row = self.placed(self.named(row))
        if "mimic" in row and row["mimic"]["joint"] in self.joints:
            row["mimic"] = {**row["mimic"], "joint": row["mimic"]["joint"] + self.suffix}
        return row

    def named(self, told):
        """With other names of the joint and of the link that it moves."""
        return {**told, **{key: told[key] + self.suffix for key in ("joint", "link") if key in told}}

    def placed(self, told):
        """With another name of the antecedent, where it is a link of the leg."""
        return (
            {**told, "antecedent": told["antecedent"] + self.suffix} if told.get("antecedent") in self.links else told
        )
