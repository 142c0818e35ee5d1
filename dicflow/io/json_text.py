"""JSON from unknown sources: plain values, with limits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NoReturn

from dicflow.errors import InputError
from dicflow.io.text import read_text

__all__ = ["read_json"]

_MAX_DIGITS = 100


def read_json(path: Path, what: str, most_bytes: int) -> Any:
    """The value that a JSON file holds; every number in it is finite.

    what : noun for messages, such as "a region in GeoJSON"
    Raises InputError, with line and column where they are known, if it cannot be read or is not JSON.
    """
    text = read_text(path, what, most_bytes, western=True)

    def whole(digits: str) -> int:
        if len(digits) > _MAX_DIGITS:
            raise InputError(str(path), f"holds a number of {len(digits)} digits", f"write {_MAX_DIGITS} at most")
        return int(digits)

    def finite(digits: str) -> float:
        value = float(digits)
        return value if abs(value) < float("inf") else refuse(digits)

    def refuse(word: str) -> NoReturn:
        raise InputError(str(path), f"holds {word:.30}, expected finite numbers", "export it again without it")

    try:
        return json.loads(text, parse_int=whole, parse_float=finite, parse_constant=refuse)
    except json.JSONDecodeError as error:
        where, reason = f"{path}:{error.lineno}:{error.colno}", error.msg.lower()
        raise InputError(where, f"expected {what}, but it is not valid JSON ({reason})", "export it again") from error
    except RecursionError as error:
        raise InputError(str(path), "has too many lists or objects inside each other", "export it again") from error
