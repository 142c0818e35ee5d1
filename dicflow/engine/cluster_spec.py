"""What a run needs to know to start workers as jobs of a cluster. Imports nothing of dask."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dicflow.discovery import nearest
from dicflow.errors import ConfigurationError

__all__ = ["BATCH", "KINDS", "ClusterSpec"]

BATCH: Mapping[str, str] = {
    "slurm": "dask_jobqueue.SLURMCluster",
    "pbs": "dask_jobqueue.PBSCluster",
    "lsf": "dask_jobqueue.LSFCluster",
    "sge": "dask_jobqueue.SGECluster",
}
"""Batch systems: name → class that submits jobs to it."""
KINDS: Mapping[str, str] = {**BATCH, "ssh": "distributed.SSHCluster"}
"""All that have a name."""


@dataclass(frozen=True)
class ClusterSpec:
    """A cluster whose workers a run starts and ends.

    kind : one of :data:`KINDS`, or ``package.module.Class`` of a cluster of dask's kind
    options : keyword arguments of the class
    least, most : workers; their number follows the work in between
    wait_s : how long the first job may wait in the queue [s]
    """

    kind: str
    options: Mapping[str, Any] = field(default_factory=dict)
    least: int = 1
    most: int = 1
    wait_s: float = 3600.0

    def __post_init__(self) -> None:
        """Raises ConfigurationError for an unknown name, and numbers of workers that cannot be."""
        if self.kind not in KINDS and "." not in self.kind:
            raise ConfigurationError(
                f"unknown cluster '{self.kind}'{nearest(self.kind, KINDS)}; use {', '.join(KINDS)}, or name a file"
            )
        if not 1 <= self.least <= self.most:
            raise ConfigurationError(
                f"--workers {self.least}..{self.most}: the first number must be at least 1, and no more than the second"
            )

    @property
    def place(self) -> str:
        """Module and name of the class."""
        return KINDS.get(self.kind, self.kind)
