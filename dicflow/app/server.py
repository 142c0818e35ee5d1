"""The app's server: on loopback, for one person, for the page that it serves itself."""

from __future__ import annotations

import asyncio
import json
import os
import secrets
import signal
import webbrowser
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import closing, suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler

from dicflow.app.answers import ANSWERS, Desk
from dicflow.app.explored import is_photograph
from dicflow.app.pictures import picture_path, thumbnail
from dicflow.app.project import Project
from dicflow.app.results import REPORT_POLICY, report_page
from dicflow.app.safety import HEADERS, Gate, Refused
from dicflow.app.versions import Conflict
from dicflow.errors import DicflowError
from dicflow.views.plain_text import plain

__all__ = ["application", "serve"]

_LARGEST_BYTES = 5_000_000
"""Of a question."""
_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_OWNERS = {"static": "dicflow.app", "explorer": "dicflow.explorer"}


class _Handler(RequestHandler):
    """Checks every request before anything else is done."""

    def initialize(self, gate: Gate, desk: Desk) -> None:
        self.gate, self.desk = gate, desk

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    def prepare(self) -> None:
        token = self.get_query_argument("token", "") or self.get_cookie(self.gate.cookie, "") or ""
        try:
            self.gate.check(self.request.host, self.request.headers.get("Origin"), token)
        except Refused as error:
            self.refuse(403, str(error))

    def refuse(self, status: int, message: str) -> None:
        """Answer with a sentence instead of what was asked for."""
        self.set_status(status)
        self.set_header("Content-Type", "application/json; charset=utf-8")
        self.finish(json.dumps({"message": plain(message)}))

    async def in_thread(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """The value of a call that may take long."""
        return await asyncio.get_running_loop().run_in_executor(self.desk.threads, call, *arguments)

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        words = {404: "there is no such page", 405: "there is no such page"}
        self.refuse(status_code, words.get(status_code, "a defect of dicflow; the terminal has its traceback"))


class _Page(_Handler):
    """The page; a link with the right token makes the browser remember it for this session."""

    def get(self) -> None:
        self.set_cookie(self.gate.cookie, self.gate.token, path="/", httponly=True, samesite="Strict")
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish(_static("index.html"))


class _Static(_Handler):
    """Scripts and styles of the app, and of the explorer."""

    def get(self, owner: str, name: str) -> None:
        suffix = Path(name).suffix
        try:
            content = _static(name, _OWNERS[owner])
        except OSError as error:
            raise HTTPError(404) from error
        self.set_header("Content-Type", f"{_TYPES.get(suffix, 'application/octet-stream')}; charset=utf-8")
        self.set_header("Cache-Control", "no-cache")
        self.finish(content)


class _Question(_Handler):
    """JSON in, JSON out. Status 409 says that a file has changed meanwhile, 422 that the question cannot be met."""

    async def post(self, name: str) -> None:
        if self.request.headers.get("Content-Type", "").partition(";")[0] != "application/json":
            return self.refuse(415, "questions are JSON")
        answer = ANSWERS.get(name)
        if answer is None:
            return self.refuse(404, "the page asks for what this app does not know; reload it")
        try:
            asked = json.loads(self.request.body)
            found = await self.in_thread(answer, self.desk, asked)
        except Conflict as error:
            return self.refuse(409, str(error))
        except DicflowError as error:
            return self.refuse(422, str(error))
        except (KeyError, TypeError, IndexError, json.JSONDecodeError):
            self.log_exception(*_raised())
            return self.refuse(400, "the page's question is not complete; reload the page")
        self.set_header("Content-Type", "application/json; charset=utf-8")
        self.set_header("Cache-Control", "no-store")
        self.finish(json.dumps(found, ensure_ascii=False))
        return None


class _Picture(_Handler):
    """Tiles by name, thumbnails by the photograph's path."""

    _awaited: Future[Path] | None = None

    async def get(self, name: str) -> None:
        try:
            if name == "thumbnail":
                path = await self._thumbnail(self.get_query_argument("path", ""))
            else:
                path = picture_path(self.desk.project, name)
            content = path.read_bytes()
        except DicflowError as error:
            return self.refuse(422, str(error))
        except asyncio.CancelledError:
            return None
        except OSError:
            return self.refuse(404, "this picture is not made yet; reload the page")
        self.set_header("Content-Type", "image/jpeg")
        self.set_header("Cache-Control", "private, max-age=31536000, immutable" if name != "thumbnail" else "no-cache")
        self.finish(content)
        return None

    async def _thumbnail(self, name: str) -> Path:
        """One is made at a time, in a thread of their own, so that no other answer waits for them."""
        self._awaited = self.desk.thumbnails.submit(thumbnail, self.desk.project, name)
        return await asyncio.wrap_future(self._awaited)

    def on_connection_close(self) -> None:
        """The page has left the screen: what has not begun is not made."""
        if self._awaited is not None:
            self._awaited.cancel()


class _Field(_Handler):
    """Blobs and photographs of a result, by names that follow from their content."""

    async def get(self, name: str) -> None:
        try:
            content = await self.in_thread(self.desk.field, name)
        except (DicflowError, OSError) as error:
            return self.refuse(422, str(error))
        self.set_header("Content-Type", "image/jpeg" if is_photograph(name) else "application/octet-stream")
        self.set_header("Cache-Control", "private, max-age=31536000, immutable")
        self.finish(content)
        return None


class _Report(_Handler):
    """The report, which is let in as a page of another origin."""

    async def get(self) -> None:
        try:
            content = await self.in_thread(report_page, self.desk.project, self.get_query_argument("file", ""))
        except DicflowError as error:
            return self.refuse(422, str(error))
        self.set_header("Content-Security-Policy", REPORT_POLICY)
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.set_header("Cache-Control", "no-cache")
        self.finish(content)
        return None


def _raised() -> Any:
    import sys

    return sys.exc_info()


def _static(name: str, package: str = "dicflow.app") -> bytes:
    """A file of the folder ``static`` of a package. Raises OSError."""
    return (files(package) / "static" / name).read_bytes()


def application(desk: Desk, gate: Gate) -> Application:
    """The app for the project of a desk: every page of it behind the gate."""
    given = {"gate": gate, "desk": desk}
    return Application(
        [
            (r"/", _Page, given),
            (r"/(static|explorer)/([a-z_]+\.(?:js|css|svg))", _Static, given),
            (r"/ask/([a-z_]+)", _Question, given),
            (r"/report", _Report, given),
            (r"/field/([a-z0-9_/]+)", _Field, given),
            (r"/picture/([a-z0-9_./]+)", _Picture, given),
        ],
        default_handler_class=_Missing,
        default_handler_args=given,
        log_function=lambda handler: None,
    )


class _Missing(_Handler):
    """Everything else."""

    def get(self) -> None:
        raise HTTPError(404)

    post = put = delete = patch = head = options = get


def serve(project: Project, say: Callable[[str], None], *, opens: bool = True, port: int = 0) -> None:
    """Serve a project until Ctrl-C. Runs that it started go on.

    say : receives the link
    opens : open it in the browser
    port : 0 for any that is free
    """
    os.chdir(project.folder)  # a pipeline may read below the working directory: let that be the opened folder
    with suppress(KeyboardInterrupt), closing(Desk(project)) as desk:
        asyncio.run(_serve(desk, say, opens, port))


async def _serve(desk: Desk, say: Callable[[str], None], opens: bool, port: int) -> None:
    try:
        sockets = bind_sockets(port, "127.0.0.1")
    except OSError as error:
        raise DicflowError(f"port {port} is taken ({error.strerror}); name another, or none") from error
    gate = Gate(sockets[0].getsockname()[1], secrets.token_urlsafe(24))
    server = HTTPServer(application(desk, gate), max_body_size=_LARGEST_BYTES)
    server.add_sockets(sockets)
    say(gate.link)
    desk.begin()
    if opens:
        webbrowser.open(gate.link)
    ended = asyncio.Event()
    with suppress(NotImplementedError, RuntimeError):  # on Windows, or outside the main thread: Ctrl-C raises
        asyncio.get_running_loop().add_signal_handler(signal.SIGINT, ended.set)
    await ended.wait()
    server.stop()
