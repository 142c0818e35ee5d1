"""The manifest of what a page shows of a reading."""

from __future__ import annotations

from collections.abc import Sequence

from dicflow.explorer.cameras import camera_facts
from dicflow.explorer.content import Keep
from dicflow.explorer.curves import loads, probe_curves, probe_places
from dicflow.explorer.entries import Contents, crop_entry, first_entry, quantity_entry, reasons, step_entry
from dicflow.explorer.manifest import Manifest, QuantityEntry
from dicflow.explorer.meaning import meaning
from dicflow.explorer.reading import Reading
from dicflow.pipeline.rig_answer import rig_answer, rig_sources
from dicflow.views.colours import palette

__all__ = ["manifest_of"]

_PALETTES = ("viridis", "RdBu_r", "cividis", "magma", "turbo", "Greys_r")


def manifest_of(reading: Reading, title: str, shown: Contents, keep: Keep) -> Manifest:
    """All that a page shows, but for the numbers. title : of the pipeline"""
    source, (quantity, step) = reading.source, reading.main
    steps = [step_entry(reading, one, shown) for one in shown.steps]
    quantities = [quantity_entry(reading, one, steps) for one in reading.quantities if one["name"] in shown.quantities]
    return Manifest(
        title=title,
        **source.facts,
        main=(quantity, shown.steps.index(step) if step in shown.steps else len(shown.steps) - 1),
        steps=steps,
        first=first_entry(reading, shown),
        quantities=quantities,
        reasons=reasons(),
        places={place: [(one.low, one.quantum) for one in found] for place, found in reading.scales.places.items()},
        crops={side: crop_entry(crop) for side, crop in shown.crops.items()},
        cameras=camera_facts(reading.result, source, step, keep),
        palettes=_palettes(quantities, keep),
        curves=[] if source.facts["form"] == "difference" else probe_curves(reading.result, quantity, keep),
        probes=probe_places(reading.result),
        load=loads(reading.result, [entry["number"] for entry in steps]),
        rig=_rig_sentence(reading, keep),
        left_out=list(shown.left_out),
        meaning=meaning(quantities, source.facts["unit"]),
    )


def _rig_sentence(reading: Reading, keep: Keep) -> str:
    sources = [] if reading.source.facts["form"] == "difference" else rig_sources(reading.result)
    return keep(["rig answer", *sources], lambda: _answered(reading)).decode() if sources else ""


def _answered(reading: Reading) -> bytes:
    found = rig_answer(reading.result)
    return b"" if found is None else found.sentence.encode()


def _palettes(quantities: Sequence[QuantityEntry], keep: Keep) -> dict[str, str]:
    """The colour maps of the quantities, and a few more to choose from."""
    names = dict.fromkeys([*(one["colours"] for one in quantities), *_PALETTES])
    return {name: keep(["palette", name], lambda: palette(name, 256).tobytes()).hex() for name in names}  # noqa: B023
