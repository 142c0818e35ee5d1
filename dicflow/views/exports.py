"""Products as files in a chosen format."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from dicflow.engine.product import Product, Variable
from dicflow.errors import ConfigurationError
from dicflow.io.files import write_whole
from dicflow.io.results import csv_text, npz_bytes
from dicflow.pipeline.registry import nearest
from dicflow.pipeline.result import Result

__all__ = ["export"]

FORMATS = ("csv", "npz", "png", "opencv", "json")


def export(
    result: Result,
    output: Path,
    *,
    stage: str | None = None,
    step: str | None = None,
    quantities: Sequence[str] = (),
    to: str = "csv",
    variant: int = 0,
    force: bool = False,
) -> list[Path]:
    """Write products into a folder and return the paths.

    stage, step : names; without a step every step of the stage
    to : one of ``FORMATS``
    force : overwrite files that exist
    Raises ConfigurationError for a name or a format that does not exist, and for a file that does.
    """
    if to not in FORMATS:
        raise ConfigurationError(f"no format '{to}'{nearest(to, FORMATS)}; there are {', '.join(FORMATS)}")
    if stage is None or quantities:
        raise ConfigurationError("exports of a whole test or of chosen quantities are not available yet; name a stage")
    paths = []
    for name, content in _files(result, stage, step, to, variant):
        if (output / name).exists() and not force:
            raise ConfigurationError(f"{output / name} exists; add --force to overwrite it, or name another")
        write_whole(output / name, content)
        paths.append(output / name)
    return paths


def _files(result: Result, stage: str, step: str | None, to: str, variant: int) -> Iterator[tuple[str, bytes]]:
    """File name and contents of every product that is asked for.

    stage, step : names; without a step every step of the stage
    to : "csv", "npz" or "png"; a PNG shows one array, so there are as many as the product has on a grid. A rig may also
        be "opencv" (YAML) or "json"
    """
    steps: tuple[str | None, ...] = (step,) if step is not None else result.steps(stage) or (None,)
    for name in steps:
        product = result.product(stage, name, variant)
        stem = stage if name is None else f"{stage}_{name}"
        if to == "csv":
            yield f"{stem}.csv", csv_text(product, stem).encode()
        elif to == "npz":
            yield f"{stem}.npz", npz_bytes(product)
        elif to in ("opencv", "json"):
            yield _rig(product, stem, to)
        else:
            yield from _pictures(product, stem)


def _rig(product: Product, stem: str, to: str) -> tuple[str, bytes]:
    from dicflow.io.calibrations import opencv_text
    from dicflow.io.rig import rig_from_dict, rig_text

    if product.kind != "rig":
        raise ConfigurationError(
            f"{stem}: a product of kind {product.kind} is no calibration; export it as csv, npz or png"
        )
    rig = rig_from_dict(product.attrs["rig"])
    name, text = ("yaml", opencv_text(rig)) if to == "opencv" else ("json", rig_text(rig))
    return f"{stem}.{name}", text.encode()


def _pictures(product: Product, stem: str) -> Iterator[tuple[str, bytes]]:
    from dicflow.core.status import Status
    from dicflow.views.maps import code_picture, picture, png

    drawable = {key: variable for key, variable in product.variables.items() if _is_field(variable)}
    if not drawable:
        raise ConfigurationError(
            f"{stem}: a product of kind {product.kind} has no array to draw; export it as csv or npz"
        )
    reasons = {status.value: status.label for status in Status}
    for key, variable in drawable.items():
        title = f"{stem} · {key}"
        figure = code_picture(variable, title, reasons) if key == "status" else picture(variable, title)
        yield f"{stem}_{key}.png", png(figure)


def _is_field(variable: Variable) -> bool:
    return len(variable.dims) == 2 and variable.dims == ("row", "col") and bool(np.isfinite(variable.values).any())
