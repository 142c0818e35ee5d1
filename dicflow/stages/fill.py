"""Fill the holes of a point cloud."""

from __future__ import annotations

from typing import ClassVar, Literal

from dicflow.engine.node import Node, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.kinds.cloud import Cloud

__all__ = ["Fill", "sentence"]


class Fill(Node):
    """Give every missing point of the region the mean of its neighbours, along columns and then along rows.

    A filled point has the status FILLED; points of the background are filled too. Points outside the region stay
    without a value. The thesis's script fills the first five columns of each plane only, by a typing error.
    """

    title: ClassVar = "fill the holes of the cloud"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"cloud": Port("cloud")}
    gives: ClassVar = "cloud"

    stage: Literal["fill"] = "fill"
    window: Pixels = parameter(20.0, "length of the moving window", unit="px", ge=2)
    passes: int = parameter(5, "number of passes; wider holes need more", ge=1, le=100)

    def run(self, cloud: Product) -> Product:
        import numpy as np

        from dicflow.core.status import Status
        from dicflow.core.surfaces.filters import fill_moving_mean

        before = Cloud.read(cloud)
        status = before["status"]
        filled = fill_moving_mean(before["xyz"], round(self.window), self.passes, status != Status.OUTSIDE)
        codes = np.where(filled.filled, np.uint8(Status.FILLED), status)
        inside = int((status != Status.OUTSIDE).sum())
        share = int(filled.filled.sum()) / max(inside, 1)
        summary = {"filled_share": share}
        return Cloud.write(filled.values, codes, before.origin, summary, fit=before.fit or None, title=before.title)


def sentence(stage: Fill, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    return f"Missing points were filled by {stage.passes} passes of moving means over {stage.window:g} px."
