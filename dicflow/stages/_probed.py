"""What stands beside the readings of probes: the calibration's share, and channels of a machine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dicflow.engine.product import Variable
from dicflow.kinds.channels import Channels
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.total import Total, gradient_measures

if TYPE_CHECKING:
    from dicflow.core.probes.probe_error import ProbeError
    from dicflow.core.probes.scale_error import ScaleError

__all__ = ["beside", "probe_error"]


def beside(
    channels: Channels,
    steps: Sequence[str],
    extensometers: Sequence[str],
    variables: Mapping[str, Variable],
    rows: Sequence[dict[str, Any]],
) -> dict[str, Variable]:
    """Channels at the steps, (step,), and the strain rates of extensometers, (extensometer, step), also in the rows."""
    import numpy as np

    from dicflow.core.channels.join import rates

    columns, place = channels.columns_at(steps), {step: index for index, step in enumerate(steps)}
    for row in rows:
        row |= {column: values[place[row["step"]]] for column, values in columns.items()}
    found = {
        f"channel_{column}": Variable(("step",), np.array(values, dtype=float), channel.unit, channel.title)
        for (column, values), channel in zip(columns.items(), map(channels.of, channels.names), strict=True)
    }
    if "time_s" in columns and extensometers:
        seconds = np.array(columns["time_s"], dtype=float)
        rate = np.stack([rates(seconds, strain) for strain in variables["strain"].values])
        found["strain_rate"] = Variable(("extensometer", "step"), rate, "1/s", "strain rate")
        for row in rows:
            if row["kind"] == "extensometer":
                value = float(rate[extensometers.index(row["probe"]), place[row["step"]]])
                row["strain_rate_per_s"] = value if math.isfinite(value) else None
    return found


def probe_error(total: Total, rig: CalibratedRig | None) -> ProbeError | ScaleError | None:
    """Calibration uncertainty of a total's points, or that of one camera's scale; None if unknown."""
    import numpy as np

    from dicflow.core.probes.probe_error import ProbeError
    from dicflow.core.probes.scale_error import ScaleError
    from dicflow.core.strain.calibration_error import rig_error, thinned_grid

    if total.relative_u_of_scale is not None:
        displacements = {name: total[name] for name in "UVW"}
        return ScaleError(total.relative_u_of_scale, total["xyz"], total["xyz_reference"], displacements)
    if rig is None or rig.covariance is None or not total.in_space:
        return None
    after, before = total["xyz"], total["xyz_reference"]
    part = thinned_grid(np.isfinite(after + before).all(axis=-1))
    fitted = (after[part], before[part]) if total.rigid_motion_removed else None
    error = rig_error(rig.cameras, rig.covariance, total.frames, fitted)
    return ProbeError.with_plane_slopes(error, after, before, gradient_measures(total))
