"""What the page may ask: one function per question, from JSON to JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from dicflow.app import caliper, document, drawing, explored, folder, pictures, results, sides, stages, versions
from dicflow.app.plans import plan_of
from dicflow.app.project import USUAL, Project
from dicflow.app.runs import Runs
from dicflow.app.workers import Worker, named
from dicflow.errors import ConfigurationError, InputError
from dicflow.io.edited_yaml import Edit, edited

__all__ = ["ANSWERS", "Asked", "Desk"]

Asked = Mapping[str, Any]


_WORKS = 30
"""Pieces of work after which the process that does them is renewed, with its memory."""
_THREADS = 8


class Desk:
    """What answers need beside the question: the project, its runs, threads that answer, processes for heavy work, for
    fields, and for the photographs under them, so that no field waits for a photograph, and a thread for thumbnails."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.runs = Runs(project)
        self.series: tuple[int, Any] | None = None
        self.opened: dict[str, explored.Asked] = {}
        self._heavy, self.fields, self._photographs = Worker(_WORKS), Worker(), Worker()
        self.threads, self.thumbnails = ThreadPoolExecutor(_THREADS), ThreadPoolExecutor(1)

    def begin(self) -> None:
        """Start the process that reads fields, so that they are soon there when they are asked for."""
        self.fields.begin("explored.prepare")

    def work(self, name: str, *arguments: Any) -> Any:
        """The value of ``module.function`` of the app, called in another process, which alone loads what it needs.

        Raises WorkerError if that process dies.
        """
        return self._heavy.do(named, name, *arguments)

    def field(self, name: str) -> bytes:
        """A blob or a photograph of a result that the page has opened. Raises InputError for any other name."""
        place = explored.place_of(self.project, name)
        with suppress(OSError):
            return place.read_bytes()
        process = self._photographs if explored.is_photograph(name) else self.fields
        process.do(explored.make, self.project, self.view(place.parent.name), name)
        return place.read_bytes()

    def view(self, key: str) -> explored.Asked:
        """What an open result was asked for as. Raises InputError for one that the page has not opened."""
        if key not in self.opened:
            raise InputError(key[:32], "is not open", "reload the page")
        return self.opened[key]

    def close(self) -> None:
        """End threads and processes, when what they are at is done; what they have not begun is left."""
        for threads in (self.threads, self.thumbnails):
            threads.shutdown(wait=False, cancel_futures=True)
        for process in (self._heavy, self.fields, self._photographs):
            process.close()
        for threads in (self.threads, self.thumbnails):
            threads.shutdown()


def _project(desk: Desk, asked: Asked) -> Any:
    """The folder and its pipeline files; which one to open."""
    project = desk.project
    names = project.pipelines()
    usual = USUAL if USUAL in names else names[0] if len(names) == 1 else ""
    return {"folder": project.folder.name, "files": names, "chosen": project.chosen or usual}


def _document(desk: Desk, asked: Asked) -> Any:
    """A pipeline file: its text, digest and problems, and its graph where it is valid."""
    name, project = str(asked["file"]), desk.project
    digest = versions.digest_of(project, name)
    text, left = _text_and_problems(project, name)
    found: dict[str, Any] = {
        "digest": digest,
        "problems": left,
        "text": text,
        "can": versions.can(project),
        "stages": [],
        "title": name,
    }
    if not left:
        pipeline = project.pipeline(name)
        found |= {"stages": stages.graph_of(pipeline), "title": pipeline.title}
    return found


def _text_and_problems(project: Project, name: str) -> tuple[str | None, list[str]]:
    """The text, None where it cannot be read as such, and what is wrong with it."""
    try:
        text = document.read_pipeline(project, name).text
    except InputError as error:
        return None, str(error).splitlines()
    return text, document.problems(text, name)


def _edit(desk: Desk, asked: Asked) -> Any:
    """Write edits; ``dry`` only says what a run would then compute."""
    name, edits = str(asked["file"]), document.edits_of(asked["edits"])
    if asked.get("dry"):
        text = edited(document.read_pipeline(desk.project, name).text, name, edits)
        return plan_of(desk.project.candidate(name, text))
    return {"problems": document.edit(desk.project, name, asked["digest"], edits, str(asked["words"]))}


def _rewrite(desk: Desk, asked: Asked) -> Any:
    """Write the whole text of a pipeline file, as a person edits it; what is still wrong with it."""
    name, text = str(asked["file"]), str(asked["text"])
    if not name.lower().endswith((".yaml", ".yml")):
        raise ConfigurationError(f"{name}: is no pipeline file; name one that ends in .yaml")
    versions.change(desk.project, {name: str(asked["digest"])}, {name: text.encode()}, f"text of {name}")
    return {"problems": document.problems(text, name)}


def _undo(desk: Desk, asked: Asked) -> Any:
    return {"words": versions.undo(desk.project, asked.get("seen", {}))}


def _redo(desk: Desk, asked: Asked) -> Any:
    return {"words": versions.redo(desk.project, asked.get("seen", {}))}


def _photograph(desk: Desk, asked: Asked) -> Any:
    pipeline = desk.project.pipeline(asked["file"])
    stage = str(asked.get("stage") or drawing.stages_of(pipeline, "images")[0])
    return pictures.shown(desk.project, pipeline, stage, asked.get("step"), str(asked.get("side", "left")))


def _steps(desk: Desk, asked: Asked) -> Any:
    return pictures.steps_of(desk.project.pipeline(asked["file"]), str(asked["stage"]))


def _drawing(desk: Desk, asked: Asked) -> Any:
    """The region and the probes of a pipeline file, and the stage of the photographs that they are drawn on."""
    project, name = desk.project, str(asked["file"])
    pipeline = project.pipeline(name)
    regions = drawing.stages_of(pipeline, "region")
    probes = drawing.stages_of(pipeline, "probes")
    return {
        "regions": regions,
        "region": drawing.drawing_of(project, name, regions[0]) if regions else None,
        "images": drawing.photographs_of(pipeline, regions[0]) if regions else None,
        "probes": drawing.probes_of(pipeline, probes[0]) if probes else None,
    }


def _proposed(desk: Desk, asked: Asked) -> Any:
    return desk.work("previews.proposed_region", desk.project, str(asked["file"]), str(asked["stage"]))


def _preview(desk: Desk, asked: Asked) -> Any:
    """The grid of a stage, with edits that are not written."""
    name = str(asked["file"])
    text = document.read_pipeline(desk.project, name).text
    if asked.get("edits"):
        text = edited(text, str(desk.project.path(name)), document.edits_of(asked["edits"]))
    return desk.work("previews.grid_preview", desk.project, name, text, str(asked["stage"]))


def _draw(desk: Desk, asked: Asked) -> Any:
    drawing.write_region(desk.project, asked["file"], str(asked["stage"]), asked["drawn"], asked["seen"])
    return {}


def _probe(desk: Desk, asked: Asked) -> Any:
    wanted = (str(asked["stage"]), asked["probes"], str(asked["digest"]), asked.get("renamed") or {})
    drawing.write_probes(desk.project, asked["file"], *wanted)
    return {}


def _series(desk: Desk, asked: Asked) -> Any:
    """What the folder holds; looked at again once a photograph has come, gone or changed."""
    now = folder.listing(desk.project)
    if desk.series is None or desk.series[0] != now:
        desk.series = now, desk.work("series.found_in", desk.project)
    return desk.series[1]


def _pairings(desk: Desk, asked: Asked) -> Any:
    return desk.work("series.pairings_of", desk.project, asked["series"])


def _make(desk: Desk, asked: Asked) -> Any:
    wanted = (asked["series"], str(asked.get("square", "")), asked.get("pair_by"))
    return desk.work("series.make_pipeline", desk.project, *wanted)


def _calibration(desk: Desk, asked: Asked) -> Any:
    """The rig; with ``rig``, as it would be without pairs and corners that were chosen."""
    name, text = str(asked["file"]), document.read_pipeline(desk.project, str(asked["file"])).text
    if asked.get("rig"):
        text = edited(text, str(desk.project.path(name)), _choice(desk, asked))
    return desk.work("calibrations.calibration_of", desk.project, name, text)


def _choice(desk: Desk, asked: Asked) -> list[Edit]:
    return folder.edits_of_choice(
        desk.project,
        str(asked["file"]),
        str(asked["boards"]),
        list(asked.get("without", ())),
        str(asked["rig"]),
        asked.get("corners"),
    )


def _leave_out_of_rig(desk: Desk, asked: Asked) -> Any:
    """Write which pairs and corners a calibration leaves out."""
    words = f"{asked['rig']}: {asked['words']}"
    return {"problems": document.edit(desk.project, asked["file"], str(asked["digest"]), _choice(desk, asked), words)}


def _pairs(desk: Desk, asked: Asked) -> Any:
    return folder.pairs_of(desk.project, str(asked["file"]), str(asked["stage"]))


def _leave_out(desk: Desk, asked: Asked) -> Any:
    folder.leave_out(desk.project, asked["file"], str(asked["stage"]), list(asked["steps"]), str(asked["digest"]))
    return {}


def _parameters(desk: Desk, asked: Asked) -> Any:
    return stages.parameters_of(desk.project.pipeline(asked["file"]), str(asked["stage"]))


def _plan(desk: Desk, asked: Asked) -> Any:
    return plan_of(desk.project.pipeline(asked["file"]))


def _start(desk: Desk, asked: Asked) -> Any:
    desk.runs.start(str(asked["file"]))
    return {}


def _stop(desk: Desk, asked: Asked) -> Any:
    desk.runs.stop(str(asked["file"]))
    return {}


def _watch(desk: Desk, asked: Asked) -> Any:
    return desk.runs.watch(str(asked["file"]))


def _runs(desk: Desk, asked: Asked) -> Any:
    return desk.runs.listed(str(asked["file"]))


def _disk(desk: Desk, asked: Asked) -> Any:
    return desk.runs.size(str(asked["file"]))


def _pin(desk: Desk, asked: Asked) -> Any:
    desk.runs.pin(str(asked["file"]), str(asked["run"]), asked.get("note"))
    return {}


def _clean(desk: Desk, asked: Asked) -> Any:
    return desk.runs.clean(str(asked["file"]), int(asked["keep"]), bool(asked.get("delete")))


def _explore(desk: Desk, asked: Asked) -> Any:
    """A result for the explorer, or a difference; its blobs and photographs are asked for by name."""
    minus = None if asked.get("minus") is None else _side(asked["minus"])
    wanted = explored.Asked(_side(asked), minus, int(asked["steps"]))
    found = desk.fields.do(explored.opened, desk.project, wanted, bool(asked.get("more")))
    desk.opened[found["view"]] = wanted
    return found


def _side(asked: Asked) -> explored.Side:
    return explored.Side(str(asked["file"]), int(asked.get("variant", 0)), str(asked.get("run", "")))


def _survey(desk: Desk, asked: Asked) -> Any:
    """Look at steps of an open result for a moment."""
    key = str(asked["view"])
    wanted = (key, int(asked["steps"]), int(asked["start"]))
    return desk.fields.do(explored.survey, desk.project, desk.view(key), *wanted)


def _curve(desk: Desk, asked: Asked) -> Any:
    """Readings of a point of an open result."""
    key = str(asked["view"])
    wanted = (key, str(asked["quantity"]), int(asked["point"]))
    return desk.fields.do(explored.curve, desk.project, desk.view(key), *wanted)


def _sides(desk: Desk, asked: Asked) -> Any:
    return sides.sides_of(desk.project, str(asked["file"]))


def _caliper(desk: Desk, asked: Asked) -> Any:
    return caliper.comparison_of(desk.project, str(asked["file"]))


def _lengths(desk: Desk, asked: Asked) -> Any:
    return caliper.write_lengths(desk.project, str(asked["file"]), list(asked["lengths"]), asked["seen"])


def _written(desk: Desk, asked: Asked) -> Any:
    return {"report": results.has_report(desk.project, str(asked["file"]))}


def _formats(desk: Desk, asked: Asked) -> Any:
    return results.export_formats(desk.project, str(asked["file"]))


def _facts(desk: Desk, asked: Asked) -> Any:
    return results.facts_of(desk.project, str(asked["file"]))


def _resolution(desk: Desk, asked: Asked) -> Any:
    """Noise against resolution of a sweep; None for a pipeline with one variant."""
    if len(desk.project.pipeline(str(asked["file"])).instances) < 2:
        return None
    return desk.work("results.resolution_of", desk.project, str(asked["file"]))


def _rest(desk: Desk, asked: Asked) -> Any:
    """What the extensometers read at steps at rest; before the first run no process loads numerics for that."""
    name = str(asked["file"])
    return desk.work("results.rest_of", desk.project, name) if desk.runs.listed(name) else []


def _export(desk: Desk, asked: Asked) -> Any:
    return desk.work("results.export_files", desk.project, str(asked["file"]), asked)


def _report(desk: Desk, asked: Asked) -> Any:
    return desk.work("results.write_report", desk.project, str(asked["file"]))


ANSWERS: Mapping[str, Callable[[Desk, Asked], Any]] = {
    "project": _project,
    "document": _document,
    "edit": _edit,
    "rewrite": _rewrite,
    "undo": _undo,
    "redo": _redo,
    "photograph": _photograph,
    "steps": _steps,
    "drawing": _drawing,
    "proposed": _proposed,
    "preview": _preview,
    "draw": _draw,
    "probe": _probe,
    "series": _series,
    "pairings": _pairings,
    "make": _make,
    "calibration": _calibration,
    "leave_out_of_rig": _leave_out_of_rig,
    "pairs": _pairs,
    "leave_out": _leave_out,
    "parameters": _parameters,
    "plan": _plan,
    "start": _start,
    "stop": _stop,
    "watch": _watch,
    "runs": _runs,
    "disk": _disk,
    "explore": _explore,
    "survey": _survey,
    "curve": _curve,
    "sides": _sides,
    "caliper": _caliper,
    "lengths": _lengths,
    "written": _written,
    "formats": _formats,
    "facts": _facts,
    "resolution": _resolution,
    "rest": _rest,
    "export": _export,
    "report": _report,
    "pin": _pin,
    "clean": _clean,
}
