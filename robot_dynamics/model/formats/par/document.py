"""Parsing of a SYMORO+ .par: the header, the lists in braces and the comments, each with its line.

    (* comment *)
    NL = 6
    theta = {th1, th2 - pi/2, th3,
             th4, th5, th6}

The entries of the lists remain text; `ParEvaluator` evaluates them. A text with (* Begin of definition *) must end with
(* End of definition *), so that a file that was cut is refused; `write_par` writes both.
"""

import re
from bisect import bisect_left
from collections.abc import Iterator
from typing import NamedTuple, NoReturn

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
_NAME_COMMENT = re.compile(r"(Joints|Links|Loops|Frames)\s*=\s*(|'.*)", re.DOTALL)
_NAME = re.compile(r"\s*'([^'\n]*)'(?:\s+(\d{1,9}))?\s*(,|$)", re.ASCII)
_BEGIN_COMMENT = re.compile(r"\(\*\s*Begin of definition\s*\*\)")
_END_COMMENT = re.compile(r"\(\*\s*End of definition\s*\*\)\s*\Z")
_ROBOT_NAME = re.compile(r"Robotname\s*=\s*'([^'\n]*)'")


class Entry(NamedTuple):
    """A piece of the text, and its line, from 1; None where the text does not contain it."""

    text: str
    line: int | None


class NameComment(NamedTuple):
    """A comment that names links, joints, loops or frames.

    Attributes
    ----------
    line : int
        Line of the comment.
    names : list of (str, int or None)
        Each name with its row, None where it has none.
    """

    line: int
    names: list[tuple[str, int | None]]


class ParDocument:
    """The parts of a .par with a valid header, and with lists of the lengths that the header requires.

    Raises DescriptionError with source and line, the error and the remedy.

    Attributes
    ----------
    robot_name : str
        Name of the robot.
    links : int
        NL, the number of rows in the tree.
    joints : int
        NJ; rows from NL + 1 on are cut joints.
    frames : int
        NF; rows from NJ + 1 on are the frames k+B that close the loops, in the order of the cut joints.
    is_floating : bool
        Whether the lists of the links begin with link 0.
    lists : dict of str to list of Entry
        Entries by key. All REQUIRED_LISTS are present.
    names : dict of str to NameComment
        Comments such as (* Frames = 'tool' 7 *), under "Joints", "Links", "Loops" or "Frames".
    """

    def __init__(self, text: str | bytes, source: object) -> None:
        self.source = source
        if not isinstance(text, str | bytes):
            raise DescriptionError(f"{source} is {text!r:.60}: the text of a SYMORO+ .par, str or bytes, is needed")
        text = decode_text(text, source, "a SYMORO+ .par", MAX_PAR_LENGTH).replace("\r\n", "\n").replace("\r", "\n")
        if _BEGIN_COMMENT.search(text) and not _END_COMMENT.search(text):
            self.fail(
                text.rstrip().count("\n") + 1,
                "the text breaks off: a .par with (* Begin of definition *) ends with (* End of definition *)",
            )
        self._line_ends = [match.start() for match in re.finditer("\n", text)]
        self.robot_name = "robot"
        self.names: dict[str, NameComment] = {}
        text = self._read_comments(text)
        self.lists: dict[str, list[Entry]] = {}
        self._header: dict[str, Entry] = {}
        self._lines: dict[str, int] = {}
        self._read_statements(text)
        self.links = self.joints = self.frames = 0
        self.is_floating = False
        self._read_sizes()
        self._check_sizes()
        self._check_lists()

    def fail(self, line: int | None, message: str) -> NoReturn:
        """Raise DescriptionError with the source and a line."""
        place = self.source if line is None else f"{self.source}, line {line}"
        raise DescriptionError(f"{place}: {message}")

    def _line(self, position: int) -> int:
        """Return the line of a position in the text."""
        return bisect_left(self._line_ends, position) + 1

    def _read_comments(self, text: str) -> str:
        """Read the names in comments, and return the text with blanks in place of comments."""
        parts = []
        position = 0
        has_robot_name = False
        while (start := text.find("(*", position)) >= 0:
            end = text.find("*)", start + 2)
            if end < 0:
                self.fail(self._line(start), "the comment that (* begins never ends: close it with *)")
            comment = text[start + 2 : end]
            if not has_robot_name and (match := _ROBOT_NAME.search(comment)):
                self.robot_name = match.group(1)
                has_robot_name = True
            if match := _NAME_COMMENT.fullmatch(comment.strip()):
                self._read_names(match.group(1), match.group(2), self._line(start))
            parts += [text[position:start], re.sub(r"[^\n]", " ", text[start : end + 2])]
            position = end + 2
        return "".join([*parts, text[position:]])

    def _read_names(self, kind: str, text: str, line: int) -> None:
        """Read the names in a comment of a kind: "Joints", "Links", "Loops" or "Frames"."""
        if kind in self.names:
            self.fail(line, f"a comment {kind} = is already present at line {self.names[kind].line}")
        names: list[tuple[str, int | None]] = []
        position = 0
        while position < len(text):
            match = _NAME.match(text, position)
            if match is None or (match.group(2) is not None) != (kind == "Frames"):
                form = "'tool' 7, 'camera' 9, each with its row" if kind == "Frames" else "'one', 'two'"
                self.fail(line, f"the comment {kind} = ends in {text[position:][:40]!r}: it has the form {form}")
            names.append((match.group(1), None if match.group(2) is None else int(match.group(2))))
            position = match.end()
        self.names[kind] = NameComment(line, names)

    def _read_statements(self, text: str) -> None:
        """Read the header and the lists of a text without comments."""
        position = 0
        while match := _KEY.match(text, position):
            key = LEGACY.get(match.group(1), match.group(1))
            line = self._line(match.start(1))
            if key in self._lines:
                self.fail(line, f"{key} is already defined at line {self._lines[key]}")
            self._lines[key] = line
            if key not in HEADER and key not in LISTS:
                self.fail(line, describe_unknown_name("key", key, (*HEADER, *LISTS)))
            position = self._read_statement(text, key, line, match.end())
        if remainder := text[position:].lstrip():
            line = self._line(len(text) - len(remainder))
            beginning = remainder[:40].splitlines()[0]
            self.fail(line, f"{beginning!r} has no meaning there: NAME = number or NAME = {{..., ...}} is needed")

    def _read_statement(self, text: str, key: str, line: int, start: int) -> int:
        """Read the value of a key, which begins at `start`, and return the position of its end."""
        braces = _LIST.match(text, start)
        if (key in LISTS) != (braces is not None):
            form = "a list in braces, {..., ...}" if key in LISTS else "one number"
            self.fail(line, f"{key} = {text[start:][:20].strip().partition(chr(10))[0]}: {key} is {form}")
        if braces is None:
            end = text.find("\n", start)
            end = len(text) if end < 0 else end
            self._header[key] = Entry(text[start:end].strip(), line)
            return end
        if braces.group(2) != "}":
            self.fail(line, f"the list {key} = {{ never ends: close it with }}")
        self.lists[key] = self._entries(key, braces.group(1), braces.start(1))
        return braces.end()

    def _entries(self, key: str, content: str, start: int) -> list[Entry]:
        """Return the entries of a list, which begins at `start`: its text between commas outside parentheses."""
        parts = [*self._split(key, content, start)]
        if len(parts) == 1 and not content.strip():
            return []
        entries: list[Entry] = []
        for begin, part in parts:
            text = part.strip()
            line = self._line(start + begin + part.find(text[:1]))
            if not text:
                self.fail(line, f"entry {len(entries) + 1} of {key} is empty: a number or an expression is needed")
            entries.append(Entry(text, line))
        return entries

    def _split(self, key: str, content: str, start: int) -> Iterator[tuple[int, str]]:
        """Yield (position, text) of the parts of a list between commas outside parentheses."""
        depth = 0
        begin = 0
        for match in re.finditer(r"[(),]", content):
            depth += {"(": 1, ")": -1}.get(match.group(), 0)
            if depth < 0:
                self.fail(self._line(start + match.start()), f"a parenthesis in {key} is closed but not opened")
            if match.group() == "," and depth == 0:
                yield begin, content[begin : match.start()]
                begin = match.end()
        if depth > 0:
            self.fail(self._line(start + begin), f"a parenthesis in {key} is opened but not closed")
        yield begin, content[begin:]

    def _whole(self, key: str) -> int:
        """Return a whole number of the header."""
        entry = self._header[key]
        try:
            number = evaluate(entry.text)
        except DescriptionError as error:
            self.fail(entry.line, f"{key}: {error}")
        if number != round(number) or not 0 <= number <= 1e6:
            self.fail(entry.line, f"{key} = {entry.text[:40]}: a whole number is needed, zero or more")
        return int(number)

    def _boolean(self, key: str) -> bool:
        """Return a truth value of the header; False where it is absent."""
        entry = self._header.get(key, Entry("0", None))
        if entry.text.lower() not in BOOLEANS:
            self.fail(entry.line, f"{key} = {entry.text[:40]!r}: 0 or 1 is needed")
        return BOOLEANS[entry.text.lower()]

    def _read_sizes(self) -> None:
        """Read the header."""
        for key in ("NL", "NJ"):
            if key not in self._header:
                self.fail(None, f"{key} missing: NL = number of links and NJ = number of joints are needed")
        self.links = self._whole("NL")
        self.joints = self._whole("NJ")
        self.frames = 2 * self.joints - self.links
        if "Type" in self._header:
            self._whole("Type")
        self.is_floating = self._boolean("is_floating")

    def _check_sizes(self) -> None:
        """Raise DescriptionError where the numbers in the header contradict each other or are too large."""
        frames = self._whole("NF") if "NF" in self._header else self.frames
        if self._boolean("is_mobile"):
            self.fail(
                self._header["is_mobile"].line,
                "is_mobile = 1: bases on wheels are not supported. is_floating = 1 describes a free base, "
                "is_mobile = 0 a fixed one",
            )
        if self.links > MAX_ROWS:
            self.fail(self._header["NL"].line, f"NL = {self.links}: the maximum is {MAX_ROWS} links")
        line = self._header["NJ"].line
        if self.joints < self.links:
            self.fail(
                line,
                f"NJ = {self.joints} joints cannot move NL = {self.links} links: NJ = NL in a tree, and one joint more "
                "for each loop",
            )
        if self.frames > MAX_ROWS:
            self.fail(line, f"NJ = {self.joints}: the maximum is {MAX_ROWS} frames")
        if frames != self.frames:
            cut = self.joints - self.links
            reason = f" (one frame for each link, two for each of {cut} cut joints)" if cut else ""
            line = self._header["NF"].line
            self.fail(line, f"NF = {frames}: NF = 2 NJ - NL = {self.frames} is needed{reason}, or omit it")

    def _check_lists(self) -> None:
        """Raise DescriptionError where a list is missing or has the wrong length."""
        missing = [key for key in REQUIRED_LISTS if key not in self.lists]
        if missing:
            self.fail(None, f"{', '.join(missing)} missing: the table of the frames needs {', '.join(REQUIRED_LISTS)}")
        if self.joints > self.links and "mu" not in self.lists:
            self.fail(None, "mu missing: a robot with loops needs it to distinguish actuated joints")
        lengths = self._required_lengths()
        for key, entries in self.lists.items():
            length, reason = lengths[key]
            if len(entries) != length:
                count = f"{len(entries)} {'entry' if len(entries) == 1 else 'entries'}"
                self.fail(self._lines[key], f"{key} has {count}: it needs {reason}")

    def _required_lengths(self) -> dict[str, tuple[int, str]]:
        """Return (length, reason) of each list."""
        closing = f", of which {self.joints - self.links} close loops" if self.joints > self.links else ""
        of_rows = (self.frames, f"NF = {self.frames}, one for each frame{closing}")
        of_links = (self.links, f"NL = {self.links}, one for each link, without link 0 as is_floating = 0")
        if self.is_floating:
            of_links = (self.links + 1, f"NL + 1 = {self.links + 1}, from link 0 as is_floating = 1")
        of_joints = (self.joints, f"NJ = {self.joints}, one for each joint")
        lengths = {key: (length, f"{length}") for key, length in VECTORS.items()}
        lengths.update(dict.fromkeys(GEOMETRY, of_rows))
        lengths.update(dict.fromkeys((*INERTIA, *DRIVE, *FORCES), of_links))
        lengths.update(dict.fromkeys((*ELASTICITY, *MOTION), of_joints))
        return lengths
