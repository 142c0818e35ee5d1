import os
import shutil
import signal
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

import dask
import distributed
import psutil
import pytest
import toys
from test_execute import index, trouble
from toys import StageSpec, chain, expand, numbers, run_sync
from waiting import PATIENCE_S, started

from dicflow.engine import cluster
from dicflow.engine.schedulers import is_loopback
from dicflow.engine.store import Store
from dicflow.engine.work import KILLED
from dicflow.errors import ConfigurationError, StoreError

pytestmark = pytest.mark.slow

ROLES, PARTS = ("client", "scheduler", "worker"), ("cert", "key")


def listeners(processes):
    """Addresses on which processes listen."""
    return {
        connection.laddr.ip
        for process in processes
        for connection in process.net_connections(kind="inet")
        if connection.status == psutil.CONN_LISTEN
    }


def page(link, part):
    with urllib.request.urlopen(link.replace("/status", part), timeout=PATIENCE_S) as answer:
        return answer.read().decode()


@pytest.mark.parametrize("scheduler", ["processes", "threads"])
def test_the_dashboard_answers_on_loopback_only(folder, store, tmp_path, ours, scheduler):
    seen = {}

    def look():
        seen["listeners"] = listeners(ours())
        seen["page"] = page(seen["link"], "/status")

    def on_event(event):
        if event.kind == "dashboard":
            seen["link"] = event.text

    stages = chain(folder).stages
    graph = expand({**stages, "threads": StageSpec(toys.Threads(), {"number": "read"})})
    options = {"scheduler": scheduler, "workers": 2, "dashboard": True, "on_event": on_event, "linger": look}
    result = run_sync(graph, store, **options)
    assert result.ok, result.errors
    assert seen["link"].startswith("http://127.0.0.1:")
    assert "bokeh" in seen["page"].lower()
    assert seen["listeners"] == {"127.0.0.1"}
    assert result.product("threads/step_01").attrs == {"cv2": 1, "numba": 1}
    if scheduler == "processes":
        other = run_sync(chain(folder), Store.open(tmp_path / "other"))
        assert {name: digest for name, digest in index(result).items() if "threads" not in name} == index(other)


def test_a_worker_killed_in_the_middle_costs_nothing(folder, store, tmp_path, ours):
    """And without a dashboard nothing listens."""
    seen = []
    options = {"scheduler": "processes", "linger": lambda: seen.append(listeners(ours()))}
    result = run_sync(trouble(folder, "kill once"), store, **options)
    assert result.ok
    assert seen == [set()]
    again = run_sync(trouble(folder, "kill once"), Store.open(tmp_path / "other"))
    assert index(again) == index(result)


def test_a_task_that_always_kills_its_worker_is_named_and_no_other_suffers(folder, store):
    result = run_sync(trouble(folder, "kill"), store, scheduler="processes", keep_going=True)
    assert result.errors == [f"trouble/step_06: {KILLED}"]
    assert result.outcomes["scale/step_06"].error == "trouble/step_06 failed"
    assert result.counts == {"hit": 0, "computed": 16, "failed": 1, "skipped": 1}


def test_a_chain_goes_on_after_a_step_that_killed_two_workers(tmp_path, store):
    """The step is given up after the second death; alone it succeeds, and the steps that need it follow."""
    folder = numbers(tmp_path / "three", 3)
    stages = {**chain(folder).stages, **trouble(folder, "kill twice", above=2.0).stages}
    stages["difference"] = StageSpec(toys.Difference(), {"before": "trouble", "now": "trouble"})
    graph = expand({name: stages[name] for name in ("read", "trouble", "difference", "total", "report")})
    result = run_sync(graph, store, scheduler="processes")
    assert result.ok, result.errors
    assert result.product("report").attrs["last"] == 2.0


def test_a_flaky_stage_is_tried_again_in_a_worker(folder, store):
    assert run_sync(trouble(folder, "flaky"), store, scheduler="processes", retries=1).ok


def test_a_scheduler_that_is_already_there(folder, store, tmp_path):
    options = {"processes": False, "protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(n_workers=1, worker_dashboard_address=None, **options) as there:
        result = run_sync(chain(folder), store, scheduler=there.scheduler_address)
    assert result.counts["computed"] == 24
    assert index(result) == index(run_sync(chain(folder), Store.open(tmp_path / "other")))


def certified(folder):
    """A certificate that vouches for itself, and its key."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("needs openssl to make a certificate")
    folder.mkdir()
    files = folder / "certificate.pem", folder / "key.pem"
    kind = ["-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-subj", "/CN=dicflow"]
    command = [openssl, "req", *kind, "-out", files[0], "-keyout", files[1]]
    subprocess.run(command, check=True, capture_output=True)
    return tuple(map(str, files))


@pytest.fixture
def certificate(tmp_path):
    """What :func:`certified` makes, for the scheduler and those it trusts."""
    return certified(tmp_path / "certificate")


def trusting(certificate):
    """The certificate in dask's configuration, where a user's environment variables end up."""
    names = ("ca-file", "client.cert", "client.key")
    files = (certificate[0], *certificate)
    return dask.config.set({f"distributed.comm.tls.{name}": file for name, file in zip(names, files, strict=True)})


@pytest.fixture
def guarded(certificate):
    """Address of a scheduler with one worker that speak only to those who have the certificate."""
    roles = {f"tls_{role}_{part}": file for role in ROLES for part, file in zip(PARTS, certificate, strict=True)}
    security = distributed.Security(require_encryption=True, tls_ca_file=certificate[0], **roles)
    here = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "worker_dashboard_address": None}
    options = {"processes": False, "protocol": "tls://", "security": security, **here}
    with distributed.LocalCluster(n_workers=1, **options) as there:
        yield there.scheduler_address


def test_a_scheduler_behind_certificates(folder, store, tmp_path, guarded, certificate):
    seen = []
    with trusting(certificate):
        result = run_sync(chain(folder), store, scheduler=guarded, on_event=seen.append)
    assert guarded.startswith("tls://127.0.0.1:")
    assert result.counts["computed"] == 24
    assert index(result) == index(run_sync(chain(folder), Store.open(tmp_path / "other")))
    assert not [event for event in seen if event.kind == "warning"]


def test_certificates_that_are_missing_or_others(folder, store, tmp_path, guarded, monkeypatch):
    monkeypatch.setattr(cluster, "_PATIENCE_S", 0.3)
    nowhere = (str(tmp_path / "nowhere.pem"),) * 2
    for given, words in (
        ((None, None), "dask's settings name no certificates; set DASK_DISTRIBUTED__COMM__TLS__CA_FILE"),
        (nowhere, r"a certificate cannot be used \(.*No such file or directory\); set DASK_"),
        (certified(tmp_path / "other"), "no scheduler answers there to these certificates; start 'dask scheduler'"),
    ):
        with trusting(given), pytest.raises(ConfigurationError, match=f"{guarded}: {words}"):
            run_sync(chain(folder), store, scheduler=guarded)


@pytest.mark.parametrize(
    "address", ["tcp://", "tls://", "tcp://host", "tcp://:8786", "tcp://host:port", "tcp://host:99999", "tcp://h:1/x"]
)
def test_an_address_without_host_or_port_is_refused_at_once(folder, store, address):
    with pytest.raises(ConfigurationError, match=rf"--scheduler {address}: .* such as t(cp|ls)://127\.0\.0\.1:8786"):
        run_sync(chain(folder), store, scheduler=address)


def test_a_scheduler_that_is_not_there(folder, store, monkeypatch):
    monkeypatch.setattr(cluster, "_PATIENCE_S", 0.3)
    before = set(threading.enumerate())
    with pytest.raises(ConfigurationError, match=r"tcp://127\.0\.0\.1:9: no scheduler answers there"):
        run_sync(chain(folder), store, scheduler="tcp://127.0.0.1:9")
    assert "IO loop" not in {one.name for one in set(threading.enumerate()) - before}, "dask's thread has ended"


@pytest.fixture
def elsewhere(tmp_path):
    """Address of a scheduler, it and its worker as processes that can be killed."""
    path = f"{Path(__file__).parents[2]}{os.pathsep}{Path(__file__).parent}"
    options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": {**os.environ, "PYTHONPATH": path}}
    file = tmp_path / "scheduler.json"
    line = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    scheduling = started([*line, "--no-dashboard", "--scheduler-file", file], **options)
    line = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", file, "--nthreads", "1"]
    with scheduling as scheduler, started([*line, "--no-dashboard", "--no-nanny"], **options) as worker:
        with distributed.Client(scheduler_file=str(file), timeout=PATIENCE_S, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=PATIENCE_S)
            address = client.scheduler.address
        yield address, scheduler, worker


@pytest.mark.parametrize(
    ("lost", "words"), [("scheduler", "the scheduler has ended"), ("worker", "no worker for 1 s; start 'dask worker")]
)
def test_a_cluster_that_is_lost_in_the_middle_ends_the_run_with_one_error(
    folder, store, elsewhere, monkeypatch, capfd, lost, words
):
    monkeypatch.setattr(cluster, "_WITHOUT_WORKERS_S", 1.0 if lost == "worker" else PATIENCE_S)
    monkeypatch.setattr(cluster, "_LOOK_S", 0.2)
    address, scheduler, worker = elsewhere

    def on_event(event):
        if event.kind == "finished" and event.stage == "scale":
            {"scheduler": scheduler, "worker": worker}[lost].kill()

    result = run_sync(chain(folder, sleep_s=0.1), store, scheduler=address, on_event=on_event)
    (error,) = result.errors
    assert f"{address}: " in error
    assert words in error
    assert list(result.outcomes) == list(chain(folder).tasks)
    assert result.counts["computed"] + result.counts["skipped"] == 23
    assert "Traceback" not in capfd.readouterr().err
    assert run_sync(chain(folder), store).counts["hit"] >= 7


class Fake:
    """A client of workers that give fixed answers."""

    def __init__(self, **answers):
        self.answers = answers

    def wait_for_workers(self, *_, **__):
        if self.answers.get("workers", 1) == 0:
            raise TimeoutError

    def run(self, function, *_):
        return {"tcp://far:1": self.answers[function.__name__]}


def test_workers_with_other_versions_are_refused():
    there = {**cluster.versions(), "numpy": "1.0"}
    with pytest.raises(ConfigurationError, match=r"tcp://far:1: has numpy 1\.0 \(here .*install the same versions"):
        cluster._check_workers(Fake(versions=there))
    for name in ("scipy", "numba", "opencv-python-headless"):
        with pytest.raises(ConfigurationError, match=f"has {name} 0 "):
            cluster._check_workers(Fake(versions={**cluster.versions(), name: "0"}))
    cluster._check_workers(Fake(versions={**cluster.versions(), "zarr": "9"}, sources=cluster.sources()))
    with pytest.raises(ConfigurationError, match="the scheduler has no workers; start"):
        cluster._await_workers(Fake(workers=0), "tcp://far:0")


def test_workers_with_other_code_are_refused():
    with pytest.raises(ConfigurationError, match=r"tcp://far:1: runs different dicflow source"):
        cluster._check_workers(Fake(versions=cluster.versions(), sources="sha256:" + "0" * 64))


def test_workers_that_do_not_see_the_store_are_refused(store):
    (store.path / "runs" / "x").mkdir(parents=True)
    with pytest.raises(StoreError, match=r"the worker tcp://far:1 does not see .*put the store on a shared disk"):
        cluster._check_store(Fake(reads_probe=""), "tcp://far:0", store, "x")
    assert not list((store.path / "runs" / "x").iterdir())


@pytest.mark.parametrize(
    ("address", "here"),
    [("tcp://127.0.0.1:1", True), ("tcp://localhost:1", True), ("tcp://[::1]:1", True), ("tcp://10.0.0.1:1", False)],
)
def test_loopback(address, here):
    assert is_loopback(address) == here


def test_an_open_scheduler_elsewhere_is_warned_of(folder, store, monkeypatch):
    monkeypatch.setattr(cluster, "_PATIENCE_S", 0.1)
    seen = []
    with pytest.raises(ConfigurationError):
        run_sync(chain(folder), store, scheduler="tcp://192.0.2.1:1", on_event=seen.append)
    assert ["neither encrypted nor authenticated" in e.text for e in seen if e.kind == "warning"] == [True]


INTERRUPTED = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[3:]
from toys import chain, run_sync
from dicflow.engine.store import Store
def on_event(event):
    print(event.kind, event.stage, flush=True)
if __name__ == "__main__":
    graph = chain(Path(sys.argv[1]), sleep_s=0.5)
    result = run_sync(graph, Store.open(Path(sys.argv[2])), scheduler="processes", on_event=on_event)
    print(result.interrupted, result.counts["failed"], result.counts["skipped"] > 0, flush=True)
"""


def test_an_interrupt_of_the_whole_group_lets_workers_finish(store, tmp_path):
    """Ctrl-C in a terminal reaches every process. All 60 steps would take 15 s."""
    folder, script = numbers(tmp_path / "numbers", 60), tmp_path / "script.py"
    script.write_text(INTERRUPTED)
    command = [sys.executable, script, folder, store.path, str(Path(__file__).parent)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with started(command, start_new_session=True, **pipes) as process:
        next(line for line in iter(process.stdout.readline, "") if line == "finished scale\n")
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE_S)
    assert out.splitlines()[-1] == "True 0 True", out + err
    assert "Traceback" not in err
    assert run_sync(chain(folder), store).counts["hit"] >= 62
