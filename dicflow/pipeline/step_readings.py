"""What the probes read at one step, while the others are still to come."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dicflow.engine.node import Node
from dicflow.engine.references import Ref, arguments
from dicflow.engine.store import Store
from dicflow.kinds.probes import ProbeTable

__all__ = ["readings_of_step"]


def readings_of_step(store: Path, node: Node, step: str, total: Ref, rig: Ref | None) -> list[Mapping[str, Any]]:
    """Rows of the table of a stage ``probes`` at one step.

    store : its folder; total, rig : products in it
    Raises StageError where no probe is measured at this step.
    """
    given = arguments(Store(store), {"total": ((step, total),), "rig": rig}, {})
    return [row for row in ProbeTable.read(node.run(**given)).rows if row["step"] == step]
