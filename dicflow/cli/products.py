"""Commands that show a pipeline and its products."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dicflow.cli.options import (
    Data,
    Force,
    PipelineFile,
    Settings,
    StoreFolder,
    VariantNumber,
    load,
    say,
    stored,
    variant_index,
    write_new,
)

__all__ = ["graph", "list_products", "show"]


def graph(
    pipeline: PipelineFile,
    settings: Settings,
    data: Data = None,
    output: Annotated[Path | None, typer.Option(help="SVG file to write; default: text on the terminal")] = None,
    force: Force = False,
) -> None:
    """Show the stages and the inputs of each.

    \b
    dicflow graph pipeline.yaml
    dicflow graph pipeline.yaml --output graph.svg
    """
    from dicflow.views.graph import graph_svg, graph_text

    loaded = load(pipeline, data, None, settings)
    if output is None:
        say(graph_text(loaded.graph))
    else:
        write_new(output, graph_svg(loaded.graph).encode(), force)


def list_products(pipeline: PipelineFile, settings: Settings, data: Data = None, store: StoreFolder = None) -> None:
    """List the products of a pipeline, and how many the store holds.

    \b
    dicflow ls pipeline.yaml
    """
    from dicflow.views.console import consoles, products_table

    out, _ = consoles()
    out.print(products_table(stored(load(pipeline, data, store, settings))))


def show(
    pipeline: PipelineFile,
    product: Annotated[str, typer.Argument(help="stage, or stage/step")],
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
    variant: VariantNumber = 1,
) -> None:
    """Show one product: its arrays, their units and ranges.

    \b
    dicflow show pipeline.yaml rig
    dicflow show pipeline.yaml total/step_03
    """
    from dicflow.views.console import consoles, product_tables

    out, _ = consoles()
    stage, _sign, step = product.partition("/")
    result = stored(load(pipeline, data, store, settings))
    for part in product_tables(result.product(stage, step or None, variant_index(result, variant))):
        out.print(part, soft_wrap=isinstance(part, str))
