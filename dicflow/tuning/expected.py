"""How long a sweep will take, by what the present settings took."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

from dicflow.core.strain.gauge_kernel import GaugeSetting
from dicflow.pipeline import Pipeline
from dicflow.tuning.stages import Tuned

__all__ = ["expected_cpu_s"]

_SEARCH_SHARE = 0.5
"""Of the time of a point, what does not grow with its subset: start values and neighbours."""
_QUADRATIC = 2.0
"""Time of a quadratic subset against that of an affine one."""
_WINDOW_SHARE = 0.5
"""Of the time of a strain, what does not grow with its window."""


def expected_cpu_s(present: Pipeline, sweep: Pipeline, tuned: Tuned, settings: Sequence[GaugeSetting]) -> float:
    """Processor time of the tasks that a sweep lacks [s].

    present : the pipeline with the present settings at the same steps, which has been run
    settings : of the sweep's variants
    """
    spent, points = _spent(present), tuned.present
    setting_of: dict[str, GaugeSetting] = {}
    for names, setting in zip(sweep.instances, settings, strict=True):
        for instance in names.values():
            setting_of.setdefault(instance, setting)
    missing = [entry.task for entry in sweep.plan("ignore").entries.values() if entry.state != "hit"]
    return sum(
        spent[(task.node.stage, task.step)] * _relative(task.node.stage, setting_of[task.stage], points)
        for task in missing
    )


def _spent(present: Pipeline) -> Mapping[tuple[str, str | None], float]:
    """Stage and step → processor time [s]."""
    found: dict[tuple[str, str | None], float] = defaultdict(float)
    for entry in present.plan("ignore").entries.values():
        record = present.store.record(entry.key) if entry.key is not None else None
        if record is not None:
            found[(entry.task.node.stage, entry.task.step)] = record.made.get("stage_cpu_s", 0.0)
    return found


def _relative(stage: str, setting: GaugeSetting, present: GaugeSetting) -> float:
    """Time of a stage with other settings over that with the present ones."""
    points = (present.step_size / setting.step_size) ** 2
    if stage == "deformation":
        windows = (setting.window_points / present.window_points) ** 2
        return points * (_WINDOW_SHARE + (1.0 - _WINDOW_SHARE) * windows)
    if stage == "correlate":
        subsets = (setting.subset_size / present.subset_size) ** 2
        shape = _QUADRATIC ** ((setting.shape_function == "quadratic") - (present.shape_function == "quadratic"))
        return points * (_SEARCH_SHARE + (1.0 - _SEARCH_SHARE) * subsets * shape)
    if stage == "stereo":
        return points * (_SEARCH_SHARE + (1.0 - _SEARCH_SHARE) * (setting.subset_size / present.subset_size) ** 2)
    return points
