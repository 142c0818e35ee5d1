"""A SLURM of its own on this machine, on loopback: a controller, a node of two cores, and their login."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tests.waiting import until

__all__ = ["obstacle", "slurm"]

_CONFIGURATION = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
CommunicationParameters=NoInAddrAny
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory={memory}
PartitionName=main Nodes=ALL Default=YES State=UP
"""
_PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "sinfo")


def obstacle() -> str:
    """Why there can be no SLURM on this machine; empty if there can."""
    missing = [name for name in _PROGRAMS if _program(name) is None]
    if missing:
        return f"needs {', '.join(missing)} (Debian: apt-get install slurm-wlm munge)"
    return "" if os.geteuid() == 0 else "needs root, as whom the daemons of SLURM run"


@contextmanager
def slurm(folder: Path) -> Iterator[dict[str, str]]:
    """Run it in a folder; gives the environment in which its commands find it."""
    (folder / "state").mkdir(parents=True)
    (folder / "spool").mkdir()
    configuration = folder / "slurm.conf"
    host = socket.gethostname().partition(".")[0]
    configuration.write_text(_CONFIGURATION.format(host=host, folder=folder, ports=_free_ports(), memory=_memory()))
    environment = {**os.environ, "SLURM_CONF": str(configuration)}
    daemons: list[subprocess.Popen[bytes]] = []
    try:
        for command in (_munge(folder), ["slurmctld", "-D"], ["slurmd", "-D", "-N", host]):
            program = [str(_program(command[0])), *command[1:]]
            with (folder / f"{command[0]}.out").open("wb") as output:
                daemons.append(subprocess.Popen(program, env=environment, stdout=output, stderr=output))
            if command[0] == "munged":
                until((folder / "munge.socket").exists)
        until(lambda: "idle" in _answer(["sinfo", "-h", "-o", "%T"], environment))
        yield environment
    finally:
        for daemon in reversed(daemons):
            daemon.send_signal(signal.SIGTERM)
        for daemon in daemons:
            with suppress(subprocess.TimeoutExpired):
                daemon.wait(10.0)
            daemon.kill()


def _munge(folder: Path) -> list[str]:
    """The daemon by which the others know one another, with a key of its own."""
    key = folder / "munge.key"
    key.write_bytes(os.urandom(128))
    key.chmod(0o600)
    names = {"key-file": "key", "socket": "socket", "pid-file": "pid", "log-file": "log", "seed-file": "seed"}
    options = [f"--{option}={folder}/munge.{name}" for option, name in names.items()]
    return ["munged", "--foreground", "--force", *options]


def _program(name: str) -> str | None:
    return shutil.which(name) or shutil.which(name, path="/usr/sbin:/usr/local/sbin")


def _free_ports() -> tuple[int, int]:
    with socket.socket() as one, socket.socket() as other:
        one.bind(("127.0.0.1", 0))
        other.bind(("127.0.0.1", 0))
        return one.getsockname()[1], other.getsockname()[1]


def _answer(command: list[str], environment: dict[str, str]) -> str:
    return subprocess.run(command, env=environment, capture_output=True, text=True).stdout


def _memory() -> int:
    """That the node has [MiB]; it refuses to serve with less than it is said to have."""
    return int(0.9 * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**20)
