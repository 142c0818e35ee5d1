"""The region and the probes as a person draws them, in pixels of the left photograph at the first step."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dicflow.app.document import problems, read_pipeline
from dicflow.app.project import Project
from dicflow.app.versions import change, digest_of
from dicflow.core.photographs.polygon import Polygon
from dicflow.errors import ConfigurationError
from dicflow.io.edited_yaml import REMOVED, Edit, edited
from dicflow.io.region import geojson_text, is_geojson, read_geojson
from dicflow.kinds.region import polygons_to_json
from dicflow.pipeline import Pipeline

__all__ = ["drawing_of", "photographs_of", "probes_of", "stages_of", "write_probes", "write_region"]

_SOURCES = ("rectangle", "polygons", "file", "cut", "auto", "frame")
_DECIMALS = 2
"""Of a pixel, in the file."""
_PROBES = ("points", "lines", "extensometers", "areas")


def stages_of(pipeline: Pipeline, stage: str) -> list[str]:
    """Names in the file of the stages of one sort."""
    stages = pipeline.document.data["stages"]
    return [name for name, entry in stages.items() if isinstance(entry, dict) and entry.get("stage") == stage]


def photographs_of(pipeline: Pipeline, stage: str) -> str:
    """The stage of the file whose photographs a stage descends from: the ones that people see and draw on."""
    names = pipeline.instances[0]
    back = {instance: name for name, instance in names.items()}
    stages = pipeline.resolved()["stages"]
    instance = names[stage]
    while stages[instance]["stage"] != "images":
        inputs = stages[instance]["inputs"]
        instance = inputs["images"] if "images" in inputs else next(iter(inputs.values()))
    return back[instance]


def probes_of(pipeline: Pipeline, stage: str) -> dict[str, Any]:
    """What a stage ``probes`` holds: its name, the unit of its places, and each sort of probe by name."""
    values = pipeline.resolved()["stages"][pipeline.instances[0][stage]]
    return {"stage": stage, "unit": values["unit"], **{sort: values[sort] for sort in _PROBES}}


def drawing_of(project: Project, name: str, stage: str) -> dict[str, Any]:
    """What a stage ``region`` holds: polygons, cuts, the file and its digest, and a note on what cannot be drawn."""
    pipeline = project.pipeline(name)
    entry = pipeline.document.data["stages"][stage]
    polygons, cuts, note = _shapes(project, entry)
    file = _region_file(project, entry, stage)
    if entry.get("frame") == "tracked":
        note = "the region is given in the rectified image; what is drawn here is given in the photograph instead"
    return {
        "polygons": polygons_to_json(polygons, _DECIMALS),
        "cuts": [line.round(_DECIMALS).tolist() for line in cuts],
        "file": file,
        "digest": digest_of(project, file),
        "note": note,
    }


def _shapes(project: Project, entry: Mapping[str, Any]) -> tuple[list[Polygon], list[np.ndarray], str]:
    cuts = [np.array(line, dtype=float) for line in entry.get("cut") or ()]
    if entry.get("rectangle"):
        x0, y0, x1, y1 = entry["rectangle"]
        return [Polygon(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], dtype=float), ())], cuts, ""
    if entry.get("polygons"):
        return [_polygon(one) for one in entry["polygons"]], cuts, ""
    if not entry.get("file"):
        return [], cuts, "the region is found in the photograph; propose it here, and edit it"
    path = project.data_path(entry["file"])
    if not is_geojson(path):
        return [], cuts, f"{entry['file']} is a mask; what is drawn here takes its place"
    drawing = read_geojson(path)
    return drawing.polygons, [*cuts, *drawing.cuts], ""


def _polygon(value: Any) -> Polygon:
    """A polygon as the pipeline file has it: corners, or a mapping of exterior and holes."""
    exterior, holes = (value["exterior"], value.get("holes", ())) if isinstance(value, dict) else (value, ())
    return Polygon(_ring(exterior), tuple(map(_ring, holes)))


def _ring(places: Any) -> np.ndarray:
    """Places (n, 2) [px]. Raises ConfigurationError for what are none."""
    try:
        return np.array(places, dtype=float).reshape(-1, 2).round(_DECIMALS)
    except (TypeError, ValueError) as error:
        raise ConfigurationError("a corner is no pair of numbers; type it again") from error


def _region_file(project: Project, entry: Mapping[str, Any], stage: str) -> str:
    """Name, for the project, of the GeoJSON file that a stage reads, or that it will read once something is drawn."""
    given = str(entry.get("file") or "")
    if given and is_geojson(project.data_path(given)):
        return project.name_of(project.data_path(given))
    path = project.data_path(f"{stage}.geojson")
    number = 1
    while path.exists():
        number += 1
        path = project.data_path(f"{stage}_{number}.geojson")
    return project.name_of(path)


def write_region(project: Project, name: str, stage: str, drawn: Mapping[str, Any], seen: Mapping[str, str]) -> None:
    """Write a drawing to the stage's GeoJSON file, and let the pipeline read that file.

    Where the folder of the photographs cannot be written, the drawing stands in the pipeline file itself.

    drawn : ``polygons``, each ``exterior`` and ``holes``, and ``cuts`` [px]
    seen : digest of the pipeline file and of the region's file as the page has them
    Raises ConfigurationError for a drawing without a polygon, and Conflict if a file has changed meanwhile.
    """
    polygons = [_polygon(one) for one in drawn["polygons"]]
    cuts = [_ring(line) for line in drawn.get("cuts", ())]
    _check(polygons, cuts)
    text, _ = read_pipeline(project, name)
    entry = project.candidate(name, text).document.data["stages"][stage]
    path = project.path(_region_file(project, entry, stage))
    is_file = _can_be_written(path)
    given = path.relative_to(project.data_folder.resolve()).as_posix()
    wanted = {"file": given} if is_file else _inline(polygons, cuts)
    place = ("stages", stage)
    edits = [Edit((*place, key), REMOVED) for key in _SOURCES if key in entry and key not in wanted]
    edits += [Edit((*place, key), value) for key, value in wanted.items() if entry.get(key) != value]
    new = {project.name_of(path): geojson_text(polygons, cuts).encode()} if is_file else {}
    if edits:
        new[name] = _checked(project, name, text, edits).encode()
    change(project, seen, new, f"region {stage}")


def _can_be_written(path: Path) -> bool:
    return os.access(path if path.exists() else path.parent, os.W_OK)


def _inline(polygons: Sequence[Polygon], cuts: Sequence[np.ndarray]) -> dict[str, Any]:
    """A drawing as parameters of the stage."""
    lines = {"cut": [line.round(_DECIMALS).tolist() for line in cuts]} if cuts else {}
    return {"polygons": polygons_to_json(polygons, _DECIMALS), **lines}


def _check(polygons: Sequence[Polygon], cuts: Sequence[np.ndarray]) -> None:
    if not polygons:
        raise ConfigurationError("the region has no polygon then; draw the new outline before you delete the last one")
    rings = [ring for polygon in polygons for ring in polygon.rings]
    if any(len(ring) < 3 for ring in rings):
        raise ConfigurationError("an outline needs three corners or more; draw it again")
    if any(len(line) < 2 for line in cuts):
        raise ConfigurationError("a cut has one place only; give a line of two different places or more")
    if not all(np.isfinite(one).all() for one in [*rings, *cuts]):
        raise ConfigurationError("a corner is no number; type it again")


def write_probes(
    project: Project, name: str, stage: str, probes: Mapping[str, Any], seen: str, renamed: Mapping[str, str]
) -> None:
    """Write points, lines, extensometers and areas to the stage ``probes``, which is made or removed with the last one.

    probes : each sort → name → places [px], or the unit that the stage has
    renamed : old → new name of probes; stages that compare one follow it
    Raises ConfigurationError if a stage compares an extensometer that would be gone.
    """
    text, _ = read_pipeline(project, name)
    stages = project.candidate(name, text).document.data["stages"]
    chosen = {sort: dict(probes.get(sort) or {}) for sort in _PROBES}
    edits = [*_probe_edits(stages, stage, chosen), *_followed(stages, stage, chosen["extensometers"], renamed)]
    change(project, {name: seen}, {name: _checked(project, name, text, edits).encode()}, "probes")


def _probe_edits(stages: Mapping[str, Any], stage: str, chosen: Mapping[str, Mapping[str, Any]]) -> list[Edit]:
    given = {sort: places for sort, places in chosen.items() if places}
    if stage not in stages:
        return [Edit(("stages", stage), {"stage": "probes", **given})] if given else []
    if not given:
        return [Edit(("stages", stage), REMOVED)]
    place = ("stages", stage)
    old = stages[stage]
    edits = [Edit((*place, sort), places) for sort, places in given.items() if old.get(sort) != places]
    return edits + [Edit((*place, sort), REMOVED) for sort in _PROBES if sort in old and sort not in given]


def _followed(
    stages: Mapping[str, Any], stage: str, extensometers: Mapping[str, Any], renamed: Mapping[str, str]
) -> list[Edit]:
    """Edits of the stages that compare an extensometer which has another name now."""
    before = (stages.get(stage) or {}).get("extensometers") or {}
    edits = []
    for name, entry in stages.items():
        compared = str(entry.get("extensometer")) if isinstance(entry, dict) else ""
        if compared in before and compared not in extensometers:
            new = renamed.get(compared, "")
            if new not in extensometers:
                raise ConfigurationError(
                    f"{name} compares the extensometer '{compared}'; choose another one at the caliper first"
                )
            edits.append(Edit(("stages", name, "extensometer"), new))
    return edits


def _checked(project: Project, name: str, text: str, edits: Sequence[Edit]) -> str:
    """The edited text. Raises ConfigurationError, in the words of the command line, if it is not valid."""
    source = str(project.path(name))
    new = edited(text, source, edits)
    if left := problems(new, source):
        raise ConfigurationError("\n".join(left))
    return new
