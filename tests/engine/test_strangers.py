"""Who else on this machine can reach a run: nobody, unless a dashboard is asked for, and then only its pages."""

from __future__ import annotations

import os
import pwd
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import distributed
import pytest
from toys import chain, run_sync
from waiting import PATIENCE_S

pytestmark = pytest.mark.slow

KNOCK = """
import os, socket, sys, threading, time
import distributed
patience_s, account, *doors = sys.argv[1:]
if account:
    here = {"processes": False, "protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": None}
    with distributed.LocalCluster(n_workers=0, worker_dashboard_address=None, **here) as cluster:
        cluster.get_client().run_on_scheduler(os.getpid)  # loads a client, which the account may not read
    os.setgroups([])
    os.setgid(int(account))
    os.setuid(int(account))

def knock(door):
    if door.isdecimal():
        distributed.Client(f"tcp://127.0.0.1:{door}", timeout=float(patience_s)).run_on_scheduler(os.getpid)
    elif door.startswith("/proc/"):
        os.open(door, os.O_RDWR | os.O_NONBLOCK)
    else:
        socket.socket(socket.AF_UNIX).connect(door.replace("@", chr(0), 1))

def enter(door):
    try:
        knock(door)
    except (OSError, TimeoutError):
        return
    print(door, flush=True)

knocking = [threading.Thread(target=enter, args=(door,), daemon=True) for door in doors]
for one in knocking:
    one.start()
end = time.monotonic() + 5 * float(patience_s)
for one in knocking:
    one.join(max(0, end - time.monotonic()))
os._exit(0)
"""
"""Knocks at ports, named sockets and pipes, if asked as another account, and prints which let it in.

A server of pages never answers dask's greeting, so that not every knock ends.
"""


def connections(processes, kind):
    return [one for process in processes for one in process.net_connections(kind=kind)]


def listening(processes):
    """Address and port of every socket of processes that waits for others."""
    return {tuple(one.laddr) for one in connections(processes, "inet") if one.laddr and not one.raddr}


def named_sockets(processes):
    """Sockets that have a name in the file system or beside it."""
    return {one.laddr for one in connections(processes, "unix") if one.laddr}


def pipes(processes):
    """Pipes and sockets of processes, as the system shows them to others."""
    return {str(path) for process in processes for path in Path(f"/proc/{process.pid}/fd").glob("*") if _is_pipe(path)}


def _is_pipe(path):
    try:
        return os.readlink(path).startswith(("pipe:", "socket:"))
    except OSError:
        return False


def entered(doors, account="", patience_s=1.0):
    """The doors that let a process in. account : its number if it is another one; patience_s : with each door"""
    command = [sys.executable, "-c", KNOCK, str(patience_s), str(account), *map(str, doors)]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=6 * PATIENCE_S).stdout.split()


@pytest.fixture
def during(folder, store):
    """Calls a function while a run with two workers is at its end, with the dashboard's link if there is one."""

    def run(look, **options):
        links, found = [""], []
        events = {"on_event": lambda event: links.append(event.text) if event.kind == "dashboard" else None}
        linger = {"linger": lambda: found.append(look(links[-1]))}
        graph = chain(folder)
        result = run_sync(graph, store, scheduler="processes", workers=2, **events, **linger, **options)
        assert result.ok, result.errors
        return found[0]

    return run


@pytest.fixture
def other_account():
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("only root can act as a second account")
    return pwd.getpwnam("nobody").pw_uid


def test_a_run_listens_nowhere(during, ours):
    assert during(lambda _: (listening(ours()), named_sockets(ours()))) == (set(), set())


def test_a_client_of_dasks_is_refused(during, ours):
    """The ports are those of the dashboard, and none of them takes commands."""

    def knock(_):
        return {host for host, _ in listening(ours())}, entered(port for _, port in listening(ours()))

    assert during(knock, dashboard=True) == ({"127.0.0.1"}, [])


def test_another_account_finds_no_way_in(during, ours, other_account):
    """Neither by a port, nor by a socket with a name, nor by the pipes between this process and its workers."""

    def knock(_):
        doors = [*(port for _, port in listening(ours())), *named_sockets(ours()), *pipes(ours())]
        return len(doors), entered(doors, other_account)

    number, open_doors = during(knock, dashboard=True)
    assert number > 4
    assert open_doors == []


def test_the_knock_would_be_heard(during, other_account):
    """Another account does enter a cluster of dask's without certificates."""
    options = {"processes": False, "protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(n_workers=1, worker_dashboard_address=None, **options) as cluster:
        port = cluster.scheduler.port
        assert entered([port], other_account, PATIENCE_S) == [str(port)]


def status(link, page, method="GET"):
    request = urllib.request.Request(link.replace("/status", page), method=method)
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def plots_for(link, origin):
    """Status with which the plots' data are given to a page of some origin in a browser."""
    address = link.removeprefix("http://").removesuffix("/status")
    upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13"
    key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="
    with socket.create_connection((address.split(":")[0], int(address.split(":")[1])), timeout=PATIENCE_S) as browser:
        head = f"GET /status/ws HTTP/1.1\r\nHost: {address}\r\nOrigin: {origin}\r\n{upgrade}\r\n{key}\r\n\r\n"
        browser.sendall(head.encode())
        return int(browser.recv(100).split()[1])


def test_the_dashboard_shows_plots_and_takes_nothing(during, ours):
    logs = ("/info/main/workers.html", "/info/logs.html", "/json/counts.json", "/metrics", "/health", "/proxy/80/x")
    pages = (*logs, "/profile", "/profile-server", "/exceptions", "/events", "/hardware", "/individual-profile")

    def look(link):
        others = [f"http://127.0.0.1:{port}/status" for _, port in listening(ours()) if f":{port}/" not in link]
        hidden = {status(link, page) for page in pages}
        hidden |= {status(other, page) for other in others for page in ("/status", "/system", "/profile", "/", "/x")}
        origins = plots_for(link, link.removesuffix("/status")), plots_for(link, "http://example.org")
        return status(link, "/status"), status(link, "/status", "POST"), hidden, origins

    assert during(look, dashboard=True) == (200, 405, {404}, (101, 403))
