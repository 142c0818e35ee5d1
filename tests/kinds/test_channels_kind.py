"""Channels, written and read."""

import numpy as np
import pytest

from dicflow.errors import StageError
from dicflow.kinds.channels import Channel, Channels

STEPS = ["a", "b", "c"]
FORCE = Channel(np.array([0.0, 2.5, np.nan]), "N", "force", np.array([0.1, 0.1, np.nan]), ("", "", "the log ends"))
TIME = Channel(np.array([0.0, 1.0, 2.0]), "s", "time")


def written(load="force"):
    return Channels.read(Channels.write({"force": FORCE, "time": TIME}, STEPS, load, ["loading"] * 3))


def test_channels_come_back_as_written():
    read = written()
    force, time = read.of("force"), read.of("time")
    assert (read.steps, read.names, read.load) == (tuple(STEPS), ("force", "time"), "force")
    assert (force.unit, force.title, force.reasons) == ("N", "force", FORCE.reasons)
    np.testing.assert_array_equal(force.values, FORCE.values)
    np.testing.assert_array_equal(force.u, FORCE.u)
    assert time.u is None
    assert time.reasons == ("", "", "")
    assert read.phases == ("loading",) * 3


def test_rows_have_units_in_their_names_and_none_for_unknown():
    rows = written().rows
    assert rows[1] == {"step": "b", "phase": "loading", "force_N": 2.5, "u_force_N": 0.1, "time_s": 1.0}
    assert rows[2]["force_N"] is None


def test_unknown_names_and_missing_loads_are_named():
    with pytest.raises(StageError, match="force, time"):
        written().of("torque")
    assert not written(None).has_load
    with pytest.raises(StageError, match="load"):
        _ = written(None).load
