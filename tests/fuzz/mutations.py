"""Changes of valid files, from a seeded generator: bytes, numbers, words, lines, brackets, encodings, sizes."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

__all__ = ["mutated"]

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_SPACE = re.compile(r"[ \t]+")
_NUMBERS = (
    *("0", "-1", "1e308", "-1e308", "1e999", "inf", "-inf", "nan", ".inf", ".nan", "Infinity", "NaN", "1e-320"),
    *(
        "7" * 400,
        "9" * 25,
        "0x" + "f" * 300,
        "1_000",
        "1,234",
        "59,95",
        "1.234,5",
        "1 234",
        "−1.5",
        "٣",
        "1e",
        "1.",
        ".5",
    ),
    *("2147483648", "18446744073709551616", "true", "null", "''", '"1"', "[]", "{}", "[1, 2]", "=1+1", "@x", "-1.5"),
)
_PIECES = (
    *(
        "\t",
        "\0",
        "\x1b[31m",
        "\r",
        "\n",
        "\u00a0",
        "\u202e",
        "\ufeff",
        "“",
        "”",
        "’",
        "é",
        "漢",
        "😀",
        "\u2028",
        "\x85",
    ),
    *(
        "\\",
        "\\*",
        "\\x1b",
        "\\u0000",
        '"',
        "'",
        "`",
        "#",
        "%",
        "@",
        "!",
        "!!python/name:os.system",
        "&a ",
        "*a",
        "<<: *a",
    ),
    *(
        ";",
        ",",
        ":",
        ": ",
        "- ",
        "? ",
        "|",
        ">",
        "{",
        "}",
        "[",
        "]",
        "<",
        ">",
        "</",
        "<!ENTITY a 'b'>",
        "&a;",
        "=cmd|' /C calc'!A0",
    ),
    *(
        "../",
        "/",
        "~",
        "$",
        "${HOME}",
        "$_{",
        "..",
        "con",
        "nul.",
        "sep=;\n",
        "%YAML:1.0\n",
        "---\n",
        "...\n",
        "PK\x03\x04",
    ),
)
_MOST_BYTES = 300_000
_ENCODINGS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-be", "cp1252", "latin-1", "cp437")


def mutated(seed: bytes, chance: random.Random) -> bytes:
    """A seed after one to four changes; text is changed as text."""
    data = seed
    for _ in range(chance.choice((1, 1, 1, 2, 3, 4))):
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            data = chance.choice(_OF_BYTES)(data, chance)
            continue
        change = chance.choice(_OF_TEXT) if chance.random() < 0.85 else None
        if change is not None:
            data = change(text, chance).encode("utf-8", errors="surrogatepass")
        else:
            data = chance.choice((*_OF_BYTES, _encoded))(data, chance)
        data = data[:_MOST_BYTES]
    return data


def _place(length: int, chance: random.Random) -> int:
    return chance.randrange(length + 1)


def _slice(length: int, chance: random.Random) -> slice:
    start = _place(length, chance)
    return slice(start, min(length, start + int(2 ** chance.uniform(0, 8))))


def _flipped(data: bytes, chance: random.Random) -> bytes:
    if not data:
        return b"\0"
    place = chance.randrange(len(data))
    return data[:place] + bytes([data[place] ^ (1 << chance.randrange(8))]) + data[place + 1 :]


def _cut(data: bytes, chance: random.Random) -> bytes:
    return data[: _place(len(data), chance)]


def _without(data: bytes, chance: random.Random) -> bytes:
    part = _slice(len(data), chance)
    return data[: part.start] + data[part.stop :]


def _doubled(data: bytes, chance: random.Random) -> bytes:
    part = _slice(len(data), chance)
    return data[: part.stop] + data[part] * chance.choice((1, 2, 100)) + data[part.stop :]


def _overwritten(data: bytes, chance: random.Random) -> bytes:
    new = chance.choice(
        (b"\0\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\1\0\0\0", chance.randbytes(4))
    )
    place = _place(len(data), chance)
    return data[:place] + new + data[place + len(new) :]


def _encoded(data: bytes, chance: random.Random) -> bytes:
    text = data.decode("utf-8", errors="replace")
    if chance.random() < 0.5:
        text = text.replace("\n", chance.choice(("\r\n", "\r", "\n\n", "\u2028")))
    return text.encode(chance.choice(_ENCODINGS), errors="replace")


def _replaced(pattern: re.Pattern[str], choices: tuple[str, ...]) -> Callable[[str, random.Random], str]:
    """A change of one place, or of all, that a pattern finds."""

    def change(text: str, chance: random.Random) -> str:
        found = list(pattern.finditer(text))
        if not found:
            return text
        new = chance.choice(choices or [one[0] for one in found])
        if chance.random() < 0.1:
            return pattern.sub(lambda _: new, text, count=100)
        one = chance.choice(found)
        return text[: one.start()] + new + text[one.end() :]

    return change


def _inserted(text: str, chance: random.Random) -> str:
    place, piece = _place(len(text), chance), chance.choice(_PIECES)
    return text[:place] + piece * chance.choice((1, 1, 1, 3, 1000)) + text[place:]


def _lines(text: str, chance: random.Random) -> str:
    lines = text.split("\n")
    one, two = chance.randrange(len(lines)), chance.randrange(len(lines))
    kind = chance.randrange(5)
    if kind == 0:
        del lines[one]
    elif kind == 1:
        lines[one], lines[two] = lines[two], lines[one]
    elif kind == 2:
        lines.insert(two, lines[one])
    elif kind == 3:
        lines[one] = chance.choice(("\t", "  ", " ", "\u00a0 ")) + lines[one].lstrip()
    else:
        lines[one:one] = [lines[one]] * chance.choice((10, 3000))
    return "\n".join(lines)


def _nested(text: str, chance: random.Random) -> str:
    place = _place(len(text), chance)
    depth = chance.choice((3, 60, 5000))
    opening, closing = chance.choice(
        (("[", "]"), ("{a: ", "}"), ('{"a":', "}"), ("<a>", "</a>"), ("- ", ""), ("(", ")"))
    )
    return text[:place] + opening * depth + (closing * depth if chance.random() < 0.7 else "") + text[place:]


def _commas(text: str, chance: random.Random) -> str:
    """As a spreadsheet with decimal commas writes a table."""
    return text.replace(",", chance.choice((";", "\t"))).replace(".", ",")


_OF_BYTES: tuple[Callable[[bytes, random.Random], bytes], ...] = (_flipped, _cut, _without, _doubled, _overwritten)
_OF_TEXT: tuple[Callable[[str, random.Random], str], ...] = (
    *[_replaced(_NUMBER, _NUMBERS)] * 4,
    *[_replaced(_WORD, ())] * 2,
    _replaced(_WORD, _PIECES),
    _replaced(_SPACE, ("\t", "", "\u00a0", "\n")),
    _inserted,
    _inserted,
    _lines,
    _lines,
    _nested,
    _commas,
)
