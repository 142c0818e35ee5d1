"""Who may ask the app, and for what: the page it served itself, and files of the opened folder."""

from __future__ import annotations

import hmac
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from dicflow.errors import DicflowError, InputError
from dicflow.io.text import printable

__all__ = ["HEADERS", "Gate", "Refused", "inside"]

HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}
"""Sent with every answer: no script or style but the app's own files, and no other page may frame it or read it."""


class Refused(DicflowError):
    """A request that does not come from the app's own page."""


class Gate(NamedTuple):
    """What a request must carry.

    port : that the app listens on
    token : random text that only the printed link holds
    """

    port: int
    token: str

    @property
    def cookie(self) -> str:
        """Name of the cookie; cookies of one host are shared by all its ports."""
        return f"dicflow-{self.port}"

    @property
    def link(self) -> str:
        """The address to open."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    def check(self, host: str, origin: str | None, token: str) -> None:
        """Raise Refused unless host and origin are the app's own, and the token is right.

        origin : None where the browser sends none, as for an address that is typed
        """
        hosts = [f"{name}:{self.port}" for name in ("127.0.0.1", "localhost")]
        if host not in hosts:
            raise Refused(f"the app answers at {hosts[0]} only; open the link that 'dicflow app' printed")
        if origin is not None and origin not in [f"http://{name}" for name in hosts]:
            raise Refused("another page asked for this; open the link that 'dicflow app' printed")
        if not hmac.compare_digest(token.encode(), self.token.encode()):
            raise Refused("the token is missing or wrong; open the link that 'dicflow app' printed")


def inside(roots: Sequence[Path], path: Path) -> Path:
    """The path without links. Raises InputError if it lies outside all of the folders.

    roots : folders without links
    """
    try:
        place = path.resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(printable(path, 200), "cannot be followed", "name a file in the opened folder") from error
    if not any(place.is_relative_to(root) for root in roots):
        raise InputError(
            printable(path, 200), "lies outside the folder that the app was opened on", "open the app on its folder"
        )
    return place
