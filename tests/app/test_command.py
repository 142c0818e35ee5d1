"""The command app prints a link, serves until Ctrl-C, and leaves runs alone."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

import pytest
from app_serving import FILE, served, small_test
from small import dicflow
from waiting import PATIENCE_S, started, until

from dicflow.app import server
from dicflow.app.project import open_project
from dicflow.app.runs import Runs

pytestmark = pytest.mark.slow


def test_it_prints_its_link_and_ends_with_ctrl_c(tmp_path):
    path = small_test(tmp_path / "test")
    command = [sys.executable, "-m", "dicflow", "app", path, "--no-browser"]
    with started(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        link = process.stdout.readline().strip()
        assert link.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(link, timeout=PATIENCE_S) as page:
            assert page.status == 200
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(link.partition("?")[0], timeout=PATIENCE_S)
        assert refused.value.code == 403
        refused.value.close()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert said.strip() == "open this link, which is for you alone; Ctrl-C ends the app, and runs go on"


def test_runs_go_on_without_the_app(tmp_path):
    path = small_test(tmp_path / "test", steps=6)
    lines = [
        "from pathlib import Path",
        "from dicflow.app.project import open_project",
        "from dicflow.app.runs import Runs",
        f"Runs(open_project(Path({str(path)!r}))).start({FILE!r})",
    ]
    starter = "; ".join(lines)
    subprocess.run([sys.executable, "-c", starter], check=True)
    known = Runs(open_project(path))
    until(lambda: known.watch(FILE)["state"] == "done")


def test_the_app_ends_when_what_it_is_at_has_ended(tmp_path, monkeypatch):
    """Its page is gone by then; what has not begun is left."""
    path, begun, ended = small_test(tmp_path / "test"), threading.Event(), []

    def slow(desk, asked):
        begun.set()
        time.sleep(0.5)
        ended.append(asked["file"])

    monkeypatch.setattr(server, "ANSWERS", {"plan": slow})
    with served(path.parent) as app, socket.create_connection(("127.0.0.1", app.gate.port)) as page:
        body = json.dumps({"file": FILE})
        page.sendall(
            f"POST /ask/plan HTTP/1.1\r\nHost: 127.0.0.1:{app.gate.port}\r\nContent-Type: application/json\r\n"
            f"Cookie: {app.gate.cookie}={app.gate.token}\r\nContent-Length: {len(body)}\r\n\r\n{body}".encode()
        )
        assert begun.wait(PATIENCE_S)
    assert ended == [FILE]


def test_what_cannot_be_opened_is_refused(tmp_path, monkeypatch):
    dicflow("app", tmp_path / "none", "--no-browser").refuses(2, "no such folder or file")
    monkeypatch.setitem(sys.modules, "ruamel", None)
    monkeypatch.delitem(sys.modules, "ruamel.yaml", raising=False)
    dicflow("app", tmp_path, "--no-browser").refuses(2, "needs ruamel.yaml", sys.prefix, "pip install 'dicflow[app]'")
