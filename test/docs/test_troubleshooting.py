"""The messages in the tables of docs/how_to/troubleshooting.md are those of the programs."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how_to" / "troubleshooting.md").read_text(encoding="utf-8")
# messages of Python and of the middleware, words that are no messages, and a message of pieces, which the page shows
FOREIGN = ("velocity of joint", "ModuleNotFoundError", "offering incompatible QoS", "package://", "robot_description")


def test_messages_of_the_page_are_in_the_code():
    sources = [*ROOT.glob("robot_dynamics*/**/*.py"), *ROOT.glob("tools/*")]
    code = " ".join(path.read_text(encoding="utf-8") for path in sources if path.is_file())
    code = re.sub(r'"\s*\n\s*f?"', "", code)  # a message over several lines
    cells = re.findall(r"^\| ([^|]*) \|", PAGE, re.MULTILINE)
    messages = [message for cell in cells for message in re.findall(r"`([^`]*)`", cell)]
    messages = [message for message in messages if not message.startswith(FOREIGN)]
    assert len(messages) >= 25
    for message in messages:
        assert message in code, message
