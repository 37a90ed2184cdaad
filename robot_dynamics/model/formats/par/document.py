"""The text of a SYMORO+ .par taken apart: the header, the lists in braces, the comments; each with its line.

    (* comment *)
    NL = 6
    theta = {th1, th2 - pi/2, th3,
             th4, th5, th6}

What an entry of a list comes to is not asked here.
"""

import re
from bisect import bisect_left
from typing import NamedTuple

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.decoding import decode_text
from robot_dynamics.model.formats.expression import evaluate

MAX_PAR_LENGTH = 1024 * 1024  # characters; a table of a robot with a hundred joints has twenty thousand
MAX_ROWS = 2000

HEADER = ("NL", "NJ", "NF", "Type", "is_floating", "is_mobile")
GEOMETRY = ("ant", "sigma", "b", "d", "r", "gamma", "alpha", "mu", "theta")
INERTIA = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
DRIVE = ("IA", "FV", "FS")
FORCES = ("FX", "FY", "FZ", "CX", "CY", "CZ")
ELASTICITY = ("eta", "k")
MOTION = ("QP", "QDP", "GAM")
VECTORS = {"W0": 3, "WP0": 3, "V0": 3, "VP0": 3, "G": 3, "Z": 16}
LISTS = (*GEOMETRY, *INERTIA, *DRIVE, *FORCES, *ELASTICITY, *MOTION, *VECTORS)
REQUIRED_LISTS = tuple(key for key in GEOMETRY if key != "mu")  # without mu every joint is actuated
LEGACY = {"Ant": "ant", "Sigma": "sigma", "B": "b", "R": "r", "Alpha": "alpha", "Mu": "mu", "Theta": "theta"}
BOOLEANS = {"0": False, "1": True, "false": False, "true": True}

_KEY = re.compile(r"\s*([A-Za-z_]\w*)[ \t]*=[ \t]*", re.ASCII)
_LIST = re.compile(r"\s*\{([^{}=]*)(.?)", re.DOTALL)
_NAMES_TOLD = re.compile(r"(Joints|Links|Loops|Frames)\s*=\s*(|'.*)", re.DOTALL)
_NAME_TOLD = re.compile(r"\s*'([^'\n]*)'(?:\s+(\d{1,9}))?\s*(,|$)", re.ASCII)
_ROBOT_TOLD = re.compile(r"Robotname\s*=\s*'([^'\n]*)'")


class Entry(NamedTuple):
    """A piece of the text, and the line that it stands on, from 1."""

    text: str
    line: int


class ParDocument:
    """The parts of a .par whose header can be, and whose lists have the lengths that the header asks for.

    links: NL, as many as there are rows in the tree; joints: NJ, rows from NL + 1 on are cut joints; frames: NF, rows
    from NJ + 1 on are the frames k+B that close the loops, in the order of the cut joints. floating: whether the lists
    of the links begin with link 0; lists: {key: entries}, under the keys in LISTS, NEEDED are all there; names:
    {"Joints", "Links", "Loops" or "Frames": (line, [(name, number)])} of comments such as (* Frames = 'tool' 7 *), the
    number None where there is none.

    Raises DescriptionError, which tells source and line, what is wrong and what would be right.
    """

    def __init__(self, text, source):
        self.source = source
        if not isinstance(text, str | bytes):
            raise DescriptionError(f"{source} is {text!r:.60}: the text of a SYMORO+ .par, str or bytes, is needed")
        text = decode_text(text, source, "a SYMORO+ .par", MAX_PAR_LENGTH).replace("\r\n", "\n").replace("\r", "\n")
        self._line_ends = [found.start() for found in re.finditer("\n", text)]
        self.robot_name, self.names = "robot", {}
        text = self._read_comments(text)
        self._header, self.lists, self._lines = {}, {}, {}
        self._read_statements(text)
        self._read_sizes()
        self._check_lists()

    def fail(self, line, message):
        place = self.source if line is None else f"{self.source}, line {line}"
        raise DescriptionError(f"{place}: {message}")

    def _line(self, position):
        return bisect_left(self._line_ends, position) + 1

    def _read_comments(self, text):
        """The text with blanks in the place of its comments."""
        parts, position, named = [], 0, False
        while (start := text.find("(*", position)) >= 0:
            end = text.find("*)", start + 2)
            if end < 0:
                self.fail(self._line(start), "the comment that (* begins never ends: close it with *)")
            comment = text[start + 2 : end]
            if not named and (told := _ROBOT_TOLD.search(comment)):
                self.robot_name, named = told.group(1), True
            if told := _NAMES_TOLD.fullmatch(comment.strip()):
                self._read_names(told, self._line(start))
            parts += [text[position:start], re.sub(r"[^\n]", " ", text[start : end + 2])]
            position = end + 2
        return "".join([*parts, text[position:]])

    def _read_names(self, told, line):
        kind, rest = told.groups()
        if kind in self.names:
            self.fail(line, f"a comment {kind} = is there already, at line {self.names[kind][0]}")
        names, position = [], 0
        while position < len(rest):
            found = _NAME_TOLD.match(rest, position)
            if found is None or (found.group(2) is not None) != (kind == "Frames"):
                form = "'tool' 7, 'camera' 9, each with its row" if kind == "Frames" else "'one', 'two'"
                self.fail(line, f"the comment {kind} = ends in {rest[position:][:40]!r}: it has the form {form}")
            names.append((found.group(1), None if found.group(2) is None else int(found.group(2))))
            position = found.end()
        self.names[kind] = (line, names)

    def _read_statements(self, text):
        position = 0
        while found := _KEY.match(text, position):
            key, line = LEGACY.get(found.group(1), found.group(1)), self._line(found.start(1))
            if key in self._lines:
                self.fail(line, f"{key} is there already, at line {self._lines[key]}")
            self._lines[key] = line
            if key not in HEADER and key not in LISTS:
                self.fail(line, describe_unknown_name("key", key, (*HEADER, *LISTS)))
            braces = _LIST.match(text, found.end())
            if (key in LISTS) != (braces is not None):
                form = "a list in braces, {..., ...}" if key in LISTS else "one number"
                self.fail(line, f"{key} = {text[found.end() :][:20].strip().partition(chr(10))[0]}: {key} is {form}")
            if braces is None:
                position = text.find("\n", found.end())
                position = len(text) if position < 0 else position
                self._header[key] = Entry(text[found.end() : position].strip(), line)
            else:
                if braces.group(2) != "}":
                    self.fail(line, f"the list {key} = {{ never ends: close it with }}")
                self.lists[key] = self._entries(key, braces.group(1), braces.start(1))
                position = braces.end()
        if rest := text[position:].lstrip():
            line, what = self._line(len(text) - len(rest)), rest[:40].splitlines()[0]
            self.fail(line, f"{what!r} has no meaning there: NAME = number or NAME = {{..., ...}} is needed")

    def _entries(self, key, inside, start):
        """The Entries of a list, parted by the commas that stand in no parentheses."""
        parts, depth, begin = [], 0, 0
        for found in re.finditer(r"[(),]", inside):
            depth += {"(": 1, ")": -1}.get(found.group(), 0)
            if depth < 0:
                self.fail(self._line(start + found.start()), f"a parenthesis in {key} is closed but not opened")
            if found.group() == "," and depth == 0:
                parts.append((begin, inside[begin : found.start()]))
                begin = found.end()
        if depth > 0:
            self.fail(self._line(start + begin), f"a parenthesis in {key} is opened but not closed")
        parts.append((begin, inside[begin:]))
        if len(parts) == 1 and not inside.strip():
            return []
        entries = []
        for begin, part in parts:
            text = part.strip()
            line = self._line(start + begin + part.find(text[:1]))
            if not text:
                self.fail(line, f"entry {len(entries) + 1} of {key} is empty: a number or an expression is needed")
            entries.append(Entry(text, line))
        return entries

    def _whole(self, key):
        told = self._header[key]
        try:
            number = evaluate(told.text)
        except DescriptionError as error:
            self.fail(told.line, f"{key}: {error}")
        if number != round(number) or not 0 <= number <= 1e6:
            self.fail(told.line, f"{key} = {told.text[:40]}: a whole number is needed, zero or more")
        return int(number)

    def _truth(self, key):
        told = self._header.get(key, Entry("0", None))
        if told.text.lower() not in BOOLEANS:
            self.fail(told.line, f"{key} = {told.text[:40]!r}: 0 or 1 is needed")
        return BOOLEANS[told.text.lower()]

    def _read_sizes(self):
        for key in ("NL", "NJ"):
            if key not in self._header:
                self.fail(None, f"{key} missing: NL = number of links and NJ = number of joints are needed")
        self.links, self.joints = self._whole("NL"), self._whole("NJ")
        self.frames = 2 * self.joints - self.links
        frames = self._whole("NF") if "NF" in self._header else self.frames
        if "Type" in self._header:
            self._whole("Type")
        self.is_floating = self._truth("is_floating")
        if self._truth("is_mobile"):
            self.fail(
                self._header["is_mobile"].line,
                "is_mobile = 1: bases that wheels carry are not read yet. With is_floating = 1 nothing holds the base, "
                "with is_mobile = 0 it stands",
            )
        line = self._header["NJ"].line
        if self.links > MAX_ROWS:
            self.fail(self._header["NL"].line, f"NL = {self.links}: more links than {MAX_ROWS} are not read")
        if self.joints < self.links:
            self.fail(
                line,
                f"NJ = {self.joints} joints cannot move NL = {self.links} links: NJ = NL in a tree, and one joint more "
                "for each loop",
            )
        if self.frames > MAX_ROWS:
            self.fail(line, f"NJ = {self.joints}: more frames than {MAX_ROWS} are not read")
        if frames != self.frames:
            cut = self.joints - self.links
            why = f" (one frame for each link, two for each of {cut} cut joints)" if cut else ""
            line = self._header["NF"].line
            self.fail(line, f"NF = {frames}: NF = 2 NJ - NL = {self.frames} is needed{why}, or leave it out")

    def _check_lists(self):
        missing = [key for key in REQUIRED_LISTS if key not in self.lists]
        if missing:
            self.fail(None, f"{', '.join(missing)} missing: the table of the frames needs {', '.join(REQUIRED_LISTS)}")
        if self.joints > self.links and "mu" not in self.lists:
            self.fail(None, "mu missing: where loops are closed it tells which joints motors drive")
        closing = f", of which {self.joints - self.links} close loops" if self.joints > self.links else ""
        of_rows = self.frames, f"NF = {self.frames}, one for each frame{closing}"
        of_links = self.links, f"NL = {self.links}, one for each link, without link 0 as is_floating = 0"
        if self.is_floating:
            of_links = self.links + 1, f"NL + 1 = {self.links + 1}, from link 0 as is_floating = 1"
        of_joints = self.joints, f"NJ = {self.joints}, one for each joint"
        lengths = {key: (length, f"{length}") for key, length in VECTORS.items()}
        lengths.update(dict.fromkeys(GEOMETRY, of_rows))
        lengths.update(dict.fromkeys((*INERTIA, *DRIVE, *FORCES), of_links))
        lengths.update(dict.fromkeys((*ELASTICITY, *MOTION), of_joints))
        for key, entries in self.lists.items():
            needed, reason = lengths[key]
            if len(entries) != needed:
                count = f"{len(entries)} {'entry' if len(entries) == 1 else 'entries'}"
                self.fail(self._lines[key], f"{key} has {count}: it needs {reason}")
