"""Changes of valid files: bytes flipped, cut and doubled, lengths that lie, values that are none."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from functools import lru_cache
from random import Random

from hypothesis import strategies as st

#: Numbers, names, quoted text and marks: what a reader of text takes apart.
_TOKEN = re.compile(r'"[^"\n]*"|[A-Za-z_]\w*|[-+]?\d[\w.+-]*|[^\s\w]')
#: What stands for a number, name or text in its place.
NASTY = (
    *("nan", "-nan", "inf", "-inf", "NaN", "-Infinity", "null", "true", "None", "", " "),
    *(
        "0",
        "-0.0",
        "-1",
        "1",
        "2",
        "1e308",
        "-1e308",
        "1e-320",
        "1e999",
        "9223372036854775808",
        "0x10",
        "1_0",
    ),
    *("1" + "0" * 400, "9" * 5000, "1.5.5", "--1", "٣", "½", "+", "1,5"),  # digits of another script
    *('""', '"\\u0000"', '"é\u202e"', "'", '"', '"""', "\ufeff", "\x00", "\n", "\r", "\t", ";", "#", "="),
    *("[]", "{}", "[[]]", "[nan]", "[1e308, -1e308]", "{ value = nan }", "{ range = [0, 0] }"),
    *("1979-05-27", "07:32:00", "a.b.c", "[a]", "[[a]]", "{" * 2000, "[" * 2000, '{"a":' * 1500),
    *('{"array": "AAAA", "dtype": "<f8", "shape": [1]}', '{"array": 1}', '{"array": "AAAA", "dtype": "O"}'),
    *("x" * 70, "🦀" * 30, "\\n"),
)
#: Numbers that a reader may well take, in place of another number.
_NUMBERS = (
    "0",
    "1",
    "-1",
    "0.5",
    "-0.3",
    "0.01",
    "1e-5",
    "1e-9",
    "3",
    "10",
    "100",
    "1000",
    "4999",
    "1e6",
    "2e-3",
)
#: Whole numbers that lie about lengths, in any width.
_LIES = (
    0,
    1,
    2,
    7,
    127,
    255,
    2**15,
    2**16 - 1,
    2**20,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**40,
    2**63 - 1,
    2**64 - 1,
)
_FLOATS = (0.0, -1.0, 1e308, -1e308, 1e-320, float("nan"), float("inf"), float("-inf"))
#: Places of a binary file are drawn in its first part as often as in all of it: its header.
_HEADER = 256


#: Each edit of a file is drawn as a number, from which all its choices follow: quick to draw, and fewer
#: edits are a simpler example.
_EDITS = st.lists(st.integers(0, 2**64 - 1), min_size=1, max_size=4)


def edited_text(seeds: Sequence[str]) -> st.SearchStrategy[bytes]:
    """Texts with a few tokens, lines or bytes changed."""
    return st.builds(_edited_text, st.sampled_from(seeds), _EDITS)


def edited_bytes(seeds: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Files with bytes flipped, replaced, cut out or doubled, or with numbers that lie about lengths."""
    return st.builds(_edited_bytes, st.sampled_from(seeds), _EDITS)


def edited(seed: str | bytes, edits: Sequence[int]) -> bytes:
    """Return a file with these edits."""
    return _edited_text(seed, edits) if isinstance(seed, str) else _edited_bytes(seed, edits)


@lru_cache(maxsize=4)
def _tokens(text: str) -> list[tuple[int, int]]:
    """Return where the tokens of a text begin and end; the first edit of an input is one of a whole seed."""
    return [token.span() for token in _TOKEN.finditer(text)]


def _edited_text(text: str, edits: Sequence[int]) -> bytes:
    for edit in edits:
        random = Random(edit)
        tokens = _tokens(text)
        if not tokens:
            break
        (begin, end), kind = random.choice(tokens), random.randrange(11)
        if kind <= 5:
            is_number = text[end - 1].isdigit() and random.random() < 0.6
            put = random.choice(_NUMBERS if is_number else NASTY)
            text = text[:begin] + put + text[end:]
        elif kind == 6:
            other = random.choice(tokens)
            text = text[:begin] + text[slice(*other)] + text[end:]
        elif kind == 7:
            strange = "".join(
                chr(random.choice((random.randrange(128), random.randrange(0xD800)))) for _ in "12"
            )
            text = text[:begin] + strange + text[end:]
        else:
            text = _lines_changed(text, random, kind)
    data = text.encode()
    return _edited_bytes(data, edits[:1]) if edits[0] % 6 == 0 else data


def _lines_changed(text: str, random: Random, kind: int) -> str:
    lines = text.split("\n")
    at = random.randrange(len(lines))
    if kind == 8:
        del lines[at]
    elif kind == 9:
        lines[at:at] = [random.choice(lines)] * random.choice((1, 1, 2, 300))
    else:
        lines = lines[:at]
    return "\n".join(lines)


def _edited_bytes(seed: bytes, edits: Sequence[int]) -> bytes:
    if seed[8:9] == b"{" and edits[0] % 2:
        # A file of tensors: its header is text, whose length is right in half of the files.
        (length,) = struct.unpack("<Q", seed[:8])
        header = _edited_text(seed[8 : 8 + length].decode(), edits)
        return struct.pack("<Q", len(header)) + header + seed[8 + length :]
    data = bytearray(seed)
    for edit in edits:
        random = Random(edit)
        at = random.randrange(random.choice((_HEADER, len(data) + 1)))
        match random.randrange(9):
            case 0 | 1 if at < len(data):
                data[at] ^= 1 << random.randrange(8)
            case 2 if at < len(data):
                data[at] = random.randrange(256)
            case 3 | 4:
                form = random.choice(("<H", "<I", "<Q", ">H", ">I"))
                lie = random.choice((*_LIES, len(data), len(data) - at, random.randrange(1000)))
                data[at : at + struct.calcsize(form)] = struct.pack(form, lie % 256 ** struct.calcsize(form))
            case 5:
                data[at : at + 8] = struct.pack("<d", random.choice(_FLOATS))
            case 6:
                del data[at : at + random.randrange(1, 64)]
            case 7:
                begin = random.randrange(len(data) + 1)
                data[at:at] = data[begin : begin + random.randrange(1, 64)]
            case _:
                del data[at:]
    return bytes(data)
