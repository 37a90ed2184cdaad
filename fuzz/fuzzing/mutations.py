"""Mutations of texts, and of bytes of recordings."""

from __future__ import annotations

import random
import re
import struct

WORDS = """
{ } [ ] ( ) : , ' " - # &a *a !!int --- ... < > </ &amp; &#0; <!DOCTYPE_x> <!-- ]]> = (* *) | ? % @ ~ null nan inf -inf
1e400 1e-400 1e200 0 -1 -0.0 3 99999999999999999999 pi/2 1/0 x \x00 \ufeff é 日 true no (((((((( 9^9^9^9 mimic joint
link mass rpy= xyz loops: cut spherical role: passive sigma NL NJ ant th1 1.0.0 0x10 1_000 + {} [] 010 1:30 yes ~ e
"""
TOKENS = [*WORDS.split(), "\n", "\t", " ", "\u2028", "\u00a0"]
NUMBERS = ["0", "1", "-1", "2", "1e-9", "1e9", "1e200", "-1e-320", "pi", "1.5708", "0.30000000000000004", "1e400", "7"]
INTEGERS = [0, 1, 2, 7, 8, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1]
FLOATS = [0.0, -0.0, 1e-320, 1e300, -1e300, float("inf"), float("nan"), 1e9, 1.5]


def change_text(text: str, rng: random.Random, corpus: list[bytes]) -> str:
    """Return the text with one mutation."""
    start = rng.randrange(len(text) + 1)
    end = min(len(text), start + rng.choice([0, 1, 1, 2, 5, 20, 100]))
    before, middle, after = text[:start], text[start:end], text[end:]
    lines = text.split("\n")
    mutation = rng.randrange(14)
    if mutation <= 3:
        number = rng.choice(list(re.finditer(r"\d+(\.\d+)?", text)) or [None])
        if number is None:
            return text
        value = rng.choice(NUMBERS) if rng.random() < 0.5 else f"{rng.uniform(-2, 2):.3g}"
        return text[: number.start()] + value + text[number.end() :]
    if mutation == 4:
        return before + after
    if mutation == 5:
        return before + rng.choice(TOKENS) + middle + after
    if mutation == 6:
        return before + rng.choice(TOKENS) + after
    if mutation == 7:
        return before + middle * rng.choice([2, 3, 50]) + after
    if mutation == 8:
        return before + chr(rng.randrange(1, 0x300)) + after
    k = rng.randrange(len(lines))
    if mutation == 9:
        return "\n".join(lines[:k] + lines[k + 1 :] + lines[k : k + 1])
    if mutation == 10:
        return "\n".join(lines[:k] + lines[k + 1 :]) if k else text * 2
    if mutation == 11:
        return text.replace(rng.choice(text.split() or ["x"]), rng.choice(TOKENS + text.split()))
    foreign = rng.choice(corpus).decode("utf-8", "replace").split("\n")
    first = rng.randrange(len(foreign))
    return "\n".join(lines[:k] + foreign[first : first + rng.choice([1, 1, 2, 5])] + lines[k:])


def mutate_text(data: bytes, rng: random.Random, corpus: list[bytes]) -> bytes:
    """Return a text with one to four mutations, sometimes in another encoding or with a changed byte."""
    text = data.decode("utf-8", "replace")
    if rng.random() < 0.3:
        return _change_numbers(text, rng).encode("utf-8", "replace")
    for _ in range(rng.choice([1, 1, 1, 2, 2, 3, 4])):
        text = change_text(text, rng, corpus)
    kind = rng.random()
    if kind < 0.9:
        return text.encode("utf-8", "replace")
    content = text.encode(rng.choice(["utf-8", "utf-16", "utf-16-le", "utf-8-sig", "latin-1"]), "replace")
    return content if kind < 0.95 else mutate_bytes(content, rng, corpus)


def mutate_bytes(data: bytes, rng: random.Random, corpus: list[bytes]) -> bytes:
    """Return bytes with one to six mutations."""
    content = bytearray(data)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 6])):
        _change_bytes(content, rng, corpus)
    return bytes(content)


def _change_bytes(content: bytearray, rng: random.Random, corpus: list[bytes]) -> None:
    if not content:
        content += rng.choice(corpus)[:64]
        return
    at = rng.randrange(len(content))
    if rng.random() < 0.3:  # headers and indexes are at both ends
        at = (
            min(len(content) - 1, rng.randrange(300))
            if rng.random() < 0.5
            else max(0, len(content) - rng.randrange(1, 300))
        )
    mutation = rng.randrange(9)
    if mutation == 0:
        content[at] = rng.randrange(256)
    elif mutation == 1:
        content[at] ^= 1 << rng.randrange(8)
    elif mutation in (2, 3):
        size, kind = rng.choice([(2, "H"), (4, "I"), (8, "Q")])
        value = (rng.choice(INTEGERS) if rng.random() < 0.7 else rng.randrange(5000)) % (1 << (8 * size))
        content[at : at + size] = struct.pack(rng.choice("<>") + kind, value)
    elif mutation == 4:
        content[at : at + 8] = struct.pack("<d", rng.choice(FLOATS))
    elif mutation == 5:
        del content[at : at + rng.choice([1, 2, 4, 8, 100, 1000])]
    elif mutation == 6:
        size = rng.choice([1, 2, 4, 8, 50, 500])
        content[at:at] = content[at : at + size]
    elif mutation == 7:
        source = rng.choice(corpus)
        first = rng.randrange(len(source) or 1)
        size = rng.choice([8, 50, 500])
        content[at : at + size] = source[first : first + size]
    else:
        del content[at:]


def _change_numbers(text: str, rng: random.Random) -> str:
    """Return a text with other numbers, most of which a robot may have."""
    matches = list(re.finditer(r"(?<![\w.])\d+(\.\d+)?(?![\w.])", text))
    for match in sorted(rng.sample(matches, min(len(matches), rng.choice([1, 2, 4]))), key=lambda m: -m.start()):
        text = text[: match.start()] + f"{rng.uniform(0, 2):.3g}" + text[match.end() :]
    return text
