"""A page in headless Chromium, driven by its debugging protocol."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tornado.websocket import WebSocketClientConnection, websocket_connect

from tests.waiting import PATIENCE_S, until

__all__ = ["Page", "chromium", "opened"]

_OVERLAPS = """
(() => {
  const found = [];
  for (const svg of document.querySelectorAll("svg")) {
    const texts = [...svg.querySelectorAll("text")].map((text) => [text, text.getBoundingClientRect()]);
    const seen = texts.filter(([, box]) => box.width > 0 && box.height > 0);
    seen.forEach(([one, a], k) => seen.slice(k + 1).forEach(([other, b]) => {
      const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (wide > 1 && high > 2) found.push([svg.closest("section").id, one.textContent, other.textContent]);
    }));
  }
  return found;
})()
"""
_CUT = """
[...document.querySelectorAll("svg text")].filter((text) => {
  const [box, frame] = [text.getBoundingClientRect(), text.closest("svg").getBoundingClientRect()];
  return box.width > 0 && (box.left < frame.left - 2 || box.right > frame.right + 2 ||
    box.top < frame.top - 2 || box.bottom > frame.bottom + 2);
}).map((text) => [text.closest("section").id, text.textContent])
"""
_EXPLORER = """
(async () => {
  const { explorer } = document.querySelector(".explorer");
  const { canvas } = explorer.stage;
  const isOfItsSize = () => {
    const sides = explorer.stage.size.map((side) => Math.round(side * Math.min(2, devicePixelRatio)));
    return canvas.width === sides[0] && canvas.height === sides[1];
  };
  do {
    await new Promise((done) => requestAnimationFrame(done));
    await explorer.ready;
  } while (!isOfItsSize());
  return { photo: explorer.stage.photo.src, map: explorer.stage.canvas.toDataURL(),
    step: explorer.manifest.steps[explorer.scene.step].name, title: explorer.legend.title.textContent,
    bar: JSON.stringify([explorer.range, [...explorer.palette]]) };
})()
"""


def chromium() -> str | None:
    """The browser's program; None if missing."""
    return next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
    )


class Page:
    """A tab. ``events`` holds all its messages since it was opened."""

    def __init__(self, loop: asyncio.AbstractEventLoop, socket: WebSocketClientConnection) -> None:
        self._loop, self._socket, self._number = loop, socket, 0
        self.events: list[dict[str, Any]] = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self._number += 1
        number = self._number
        message = json.dumps({"id": number, "method": method, "params": parameters})
        self._loop.run_until_complete(self._written(message))
        while True:
            answer = self._read()
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return dict(answer["result"])

    def open(self, path: Path) -> None:
        """Show a file and wait until it is loaded."""
        self.events.clear()
        self.send("Page.navigate", url=path.resolve().as_uri())
        while not self.messages("Page.loadEventFired"):
            self._read()

    def messages(self, method: str) -> list[dict[str, Any]]:
        """The page's messages of one kind."""
        return [event["params"] for event in self.events if event["method"] == method]

    def complaints(self) -> list[Any]:
        """Errors and warnings on the console, and exceptions of scripts."""
        self.evaluate("0")
        entries = [message["entry"] for message in self.messages("Log.entryAdded")]
        calls = [
            message
            for message in self.messages("Runtime.consoleAPICalled")
            if message["type"] in ("error", "warning", "assert")
        ]
        loud = [entry for entry in entries if entry["level"] in ("error", "warning")]
        return [*loud, *calls, *self.messages("Runtime.exceptionThrown")]

    def requests(self) -> list[str]:
        """Addresses of all that was asked for, but data in the page itself."""
        asked = [message["request"]["url"] for message in self.messages("Network.requestWillBeSent")]
        return [address for address in asked if not address.startswith("data:")]

    def evaluate(self, script: str) -> Any:
        """The value of an expression in the page."""
        answer = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """Press and let go a key, as ``ArrowRight``."""
        code = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}[key]
        for kind in ("keyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def window(self, width: int, height: int, dark: bool = False) -> None:
        """Size of the window [CSS px], and the colours that the reader prefers."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        colours = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", features=[colours])

    def picture(self) -> bytes:
        """The whole page as a PNG."""
        return base64.b64decode(self.send("Page.captureScreenshot", captureBeyondViewport=True)["data"])

    def printed(self) -> bytes:
        """The page as a PDF."""
        return base64.b64decode(self.send("Page.printToPDF", printBackground=True)["data"])

    def explorer(self) -> dict[str, str]:
        """What the report's explorer shows: photograph and field as addresses, step, title, and its colours."""
        return dict(self.evaluate(_EXPLORER))

    def overlaps(self) -> list[list[str]]:
        """Texts of drawings that lie over each other: section, one, other."""
        return list(self.evaluate(_OVERLAPS))

    def cut(self) -> list[list[str]]:
        """Texts that stick out of their drawing: section, text."""
        return list(self.evaluate(_CUT))

    async def _written(self, message: str) -> None:
        await self._socket.write_message(message)

    def _read(self) -> dict[str, Any]:
        """The next message; one that nobody has asked for is kept."""
        text = self._loop.run_until_complete(asyncio.wait_for(_message(self._socket), PATIENCE_S))
        message: dict[str, Any] = json.loads(text)
        if "method" in message:
            self.events.append(message)
        return message


@contextmanager
def opened(folder: Path) -> Iterator[Page]:
    """An empty page in a browser of its own, which ends with the block.

    folder : empty, for the browser's files
    """
    program = chromium()
    assert program is not None
    command = [program, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    command += ["--enable-unsafe-swiftshader"]
    command += ["--remote-debugging-port=0", "--remote-allow-origins=*", f"--user-data-dir={folder}", "about:blank"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    loop = asyncio.new_event_loop()
    try:
        socket = loop.run_until_complete(_connected(_address(folder)))
        yield Page(loop, socket)
        socket.close()
    finally:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(10)
        process.kill()
        process.wait()
        loop.run_until_complete(asyncio.sleep(0.1))  # lets the closed connection say so
        loop.close()


def _address(folder: Path) -> str:
    """Where the browser's first tab is driven from."""
    file = folder / "DevToolsActivePort"
    until(lambda: file.is_file() and "\n" in file.read_text())
    port = file.read_text().splitlines()[0]
    return str(until(lambda: _pages(port))[0]["webSocketDebuggerUrl"])


def _pages(port: str) -> list[Any]:
    """Tabs of the browser that show a page."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
        return [tab for tab in json.load(answer) if tab["type"] == "page"]


async def _connected(address: str) -> WebSocketClientConnection:
    return await websocket_connect(address, max_message_size=2**28)


async def _message(socket: WebSocketClientConnection) -> str:
    message = await socket.read_message()
    assert message is not None, "the browser has ended"
    return str(message)
