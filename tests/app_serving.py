"""The app's server in this process, and questions to it as a browser or a stranger asks them."""

from __future__ import annotations

import asyncio
import http.client
import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
from small import dicflow
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from waiting import PATIENCE_S

from dicflow.app.answers import Desk
from dicflow.app.project import open_project
from dicflow.app.safety import Gate
from dicflow.app.server import application

__all__ = ["FILE", "Answer", "Served", "measure", "served", "small_test"]

FILE = "pipeline.yaml"
_TEXT = """# a test
dicflow: 1
stages:
  photos: {stage: images, left: "left/*.png"}  # the specimen

  # what is measured
  region: {stage: region, images: photos, rectangle: [20, 20, 180, 130]}
  correlation: {stage: correlate, images: photos, subset_size: 21, step_size: 5}
  total: {stage: deformation, points: correlation, window: 40 px}
"""


class Answer(NamedTuple):
    """Status, headers and body of an answer."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


class Served(NamedTuple):
    """A running server. gate : its port and token"""

    gate: Gate

    def request(self, method: str, path: str, body: Any = None, **headers: str) -> Answer:
        """A request with these headers and no others; names have _ in place of -."""
        connection = http.client.HTTPConnection("127.0.0.1", self.gate.port, timeout=PATIENCE_S)
        connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        content = b"" if body is None else json.dumps(body).encode()
        for name, value in {"Content-Length": str(len(content)), **headers}.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders(content)
        response = connection.getresponse()
        answer = Answer(response.status, {k.lower(): v for k, v in response.getheaders()}, response.read())
        connection.close()
        return answer

    def own(self, method: str, path: str, body: Any = None, **headers: str) -> Answer:
        """A request as the app's page makes it."""
        host = f"127.0.0.1:{self.gate.port}"
        sent = {"Host": host, "Origin": f"http://{host}", "Cookie": f"{self.gate.cookie}={self.gate.token}"}
        return self.request(method, path, body, **{**sent, "Content-Type": "application/json", **headers})

    def ask(self, name: str, **asked: Any) -> Answer:
        """A question of the page."""
        return self.own("POST", f"/ask/{name}", asked)

    def found(self, name: str, **asked: Any) -> Any:
        """The answer to a question that can be met."""
        answer = self.ask(name, **asked)
        assert answer.status == 200, answer.body
        return answer.json


@contextmanager
def served(path: Path, data: Path | None = None, store: Path | None = None) -> Iterator[Served]:
    """Serve a folder or a pipeline file from a thread."""
    ready, ended, found = threading.Event(), threading.Event(), []
    desk = Desk(open_project(path, data, store))

    async def serve() -> None:
        sockets = bind_sockets(0, "127.0.0.1")
        gate = Gate(sockets[0].getsockname()[1], "secret-of-the-test")
        server = HTTPServer(application(desk, gate))
        server.add_sockets(sockets)
        found.append(gate)
        ready.set()
        while not ended.is_set():
            await asyncio.sleep(0.02)
        server.stop()
        await server.close_all_connections()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert ready.wait(PATIENCE_S)
    try:
        yield Served(found[0])
    finally:
        ended.set()
        thread.join()
        desk.close()


def small_test(folder: Path, steps: int = 2, size: tuple[int, int] = (200, 150)) -> Path:
    """A pipeline file beside photographs of one camera: random speckles at rest, with noise of 3 grey levels."""
    (folder / "left").mkdir(parents=True)
    width, height = size
    rng = np.random.default_rng(1)
    coarse = rng.integers(0, 256, (height // 4 + 1, width // 4 + 1), dtype=np.uint8)
    speckles = 20.0 + 0.8 * np.asarray(Image.fromarray(coarse).resize((width, height), Image.Resampling.BICUBIC))
    for step in range(steps):
        grey = np.clip(np.round(speckles + rng.normal(0.0, 3.0, speckles.shape)), 0, 255).astype(np.uint8)
        Image.fromarray(grey).save(folder / "left" / f"step_{step:04}.png")
    (folder / FILE).write_text(_TEXT)
    return folder / FILE


def measure(path: Path) -> None:
    """Measure a pipeline file by the command line, without pictures and report, which the page does not show."""
    answer = dicflow("run", path, "--scheduler", "sync", "--no-pictures", "--no-report")
    assert answer.code == 0, answer.err
