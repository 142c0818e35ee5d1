"""Where the manual's page on troubleshooting deals with a message: by the module that it comes from."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from types import TracebackType

__all__ = ["TOPICS", "advice", "sections", "topic_of", "topic_raised"]

_PAGE = "troubleshooting.md"
_PACKAGE = Path(__file__).parents[1]

TOPICS: Mapping[str, str] = {
    "dicflow.app": "the-app",
    "dicflow.cli": "command-line",
    "dicflow.comparison": "comparing",
    "dicflow.core": "lost-points",
    "dicflow.core.calibration": "boards-and-calibration",
    "dicflow.core.channels": "tables-and-logs",
    "dicflow.core.material": "material",
    "dicflow.core.motion": "photographs",
    "dicflow.core.photographs": "photographs",
    "dicflow.discovery": "plug-ins",
    "dicflow.engine": "running-and-the-store",
    "dicflow.engine.cluster_spec": "a-cluster",
    "dicflow.engine.graph": "pipeline-file",
    "dicflow.engine.job_cluster": "a-cluster",
    "dicflow.engine.plan": "pipeline-file",
    "dicflow.engine.units": "pipeline-file",
    "dicflow.explorer": "pictures-reports-exports",
    "dicflow.io": "files-of-yours",
    "dicflow.io.buckets": "running-and-the-store",
    "dicflow.io.calibrations": "calibrations-of-other-programs",
    "dicflow.io.caliper": "tables-and-logs",
    "dicflow.io.cluster_file": "a-cluster",
    "dicflow.io.configuration": "pipeline-file",
    "dicflow.io.crate": "running-and-the-store",
    "dicflow.io.edited_yaml": "pipeline-file",
    "dicflow.io.files": "command-line",
    "dicflow.io.exports": "pictures-reports-exports",
    "dicflow.io.images": "photographs",
    "dicflow.io.logs": "tables-and-logs",
    "dicflow.io.points_table": "comparing",
    "dicflow.io.region": "region",
    "dicflow.io.results": "pictures-reports-exports",
    "dicflow.io.rig": "calibrations-of-other-programs",
    "dicflow.io.stress_table": "tables-and-logs",
    "dicflow.io.table": "tables-and-logs",
    "dicflow.io.yaml_text": "pipeline-file",
    "dicflow.kinds": "pipeline-file",
    "dicflow.kinds.kind": "lost-points",
    "dicflow.kinds.probes": "probes",
    "dicflow.kinds.rig": "boards-and-calibration",
    "dicflow.pipeline": "pipeline-file",
    "dicflow.pipeline.crate": "running-and-the-store",
    "dicflow.pipeline.past": "running-and-the-store",
    "dicflow.pipeline.rig_answer": "a-camera-has-moved",
    "dicflow.pipeline.watching": "photographs",
    "dicflow.report": "pictures-reports-exports",
    "dicflow.stages": "lost-points",
    "dicflow.stages._curve": "material",
    "dicflow.stages._joined_log": "tables-and-logs",
    "dicflow.stages._pattern": "speckles",
    "dicflow.stages._probed": "probes",
    "dicflow.stages._rig_check": "a-camera-has-moved",
    "dicflow.stages._scaled": "one-camera",
    "dicflow.stages._target": "boards-and-calibration",
    "dicflow.stages._verdict": "material",
    "dicflow.stages._window": "calibrations-of-other-programs",
    "dicflow.stages.calibrate": "boards-and-calibration",
    "dicflow.stages.channels": "tables-and-logs",
    "dicflow.stages.compare": "comparing",
    "dicflow.stages.corners": "boards-and-calibration",
    "dicflow.stages.curve": "material",
    "dicflow.stages.deformation": "noisy-or-smooth-strains",
    "dicflow.stages.features": "speckles",
    "dicflow.stages.frame": "probes",
    "dicflow.stages.hyperelastic": "material",
    "dicflow.stages.images": "photographs",
    "dicflow.stages.maps": "pictures-reports-exports",
    "dicflow.stages.noise_floor": "noisy-or-smooth-strains",
    "dicflow.stages.probes": "probes",
    "dicflow.stages.refine": "a-camera-has-moved",
    "dicflow.stages.region": "region",
    "dicflow.stages.rig_file": "calibrations-of-other-programs",
    "dicflow.stages.scale": "one-camera",
    "dicflow.stages.sheet": "material",
    "dicflow.stages.smooth": "noisy-or-smooth-strains",
    "dicflow.stages.strain": "noisy-or-smooth-strains",
    "dicflow.stages.stress": "material",
    "dicflow.stages.undistort": "one-camera",
    "dicflow.stages.virtual_fields": "material",
    "dicflow.start": "the-first-file",
    "dicflow.synth": "command-line",
    "dicflow.tuning": "noisy-or-smooth-strains",
    "dicflow.views": "pictures-reports-exports",
    "dicflow.views.solid": "pictures-reports-exports",
}
"""Module or package → section of ``docs/troubleshooting.md`` by its anchor; the nearest package of a module counts."""


def topic_of(module: str) -> str:
    """The section for messages of a module; those of a plug-in are its package's own."""
    while module not in TOPICS:
        module, dot, _ = module.rpartition(".")
        if not dot:
            return "plug-ins"
    return TOPICS[module]


def topic_raised(traceback: TracebackType | None) -> str:
    """The section for an error, by the module that raised it."""
    module = "dicflow.cli"
    while traceback is not None:
        module = traceback.tb_frame.f_globals.get("__name__", module)
        traceback = traceback.tb_next
    return topic_of(module)


def advice(topics: Iterable[str]) -> str:
    """The line below a message that says how to read its sections."""
    return f"help: dicflow help {' '.join(dict.fromkeys(topics))}"


@cache
def sections() -> Mapping[str, str]:
    """The sections of the page on troubleshooting: topic, which is its anchor, → its text with the title.

    An installation has the page in the package, a clone among its other pages.
    """
    page = _PACKAGE / _PAGE
    text = (page if page.is_file() else _PACKAGE.parent / "docs" / _PAGE).read_text(encoding="utf-8")
    parts = text.split("\n## ")[1:]
    return {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", part.partition("\n")[0]).lower()): part for part in parts}
