"""Channels of three machines' logs at the steps of photographs, with clocks that do not agree."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, InputError, StageError
from dicflow.io.configuration import parse
from dicflow.kinds.channels import Channels as Table
from dicflow.kinds.images import Images
from dicflow.pipeline.wiring import wire
from dicflow.stages.channels import Channels
from tests.log_files import START, balance_log, logger_log, machine_log

OFFSET = 12.4
"""What the log's clock shows more than that of the photographs [s]."""
TIMES = np.arange(60.0) + 0.03 * np.sin(7.0 * np.arange(60.0))
"""Of the photographs, by their own clock [s]."""
LOG = np.arange(0.0, 100.0, 0.2)


def crosshead(t):
    """Rest, 20 s of loading, rest, unloading to a part, by the photographs' clock [mm]."""
    return np.interp(t, [8.0, 28.0, 36.0, 50.0], [0.0, 30.0, 30.0, 6.0])


def force(t):
    """A rubber's force [N]."""
    return 0.9 * np.sqrt(1.0 + crosshead(t)) - 0.9


def pattern(shift):
    """A photograph of a fine pattern that has moved by a part of a pixel."""
    rng = np.random.default_rng(3)
    waves = rng.uniform(0.1, 0.4, (12, 2)), rng.uniform(0.0, 6.0, 12)
    y, x = np.mgrid[:48, :64]
    phases = waves[0][:, :1, None] * (y + shift) + waves[0][:, 1:, None] * x + waves[1][:, None, None]
    return (128.0 + 12.0 * np.sin(phases).sum(axis=0)).astype(np.float32)


def photographs(times=TIMES, start=0.0):
    noise = np.random.default_rng(5)
    images = [pattern(crosshead(t)) for t in times]
    noisy = [image + noise.normal(0.0, 1.0, image.shape).astype(np.float32) for image in images]
    return [Images.write(image, time=float(t + start)) for image, t in zip(noisy, times, strict=True)]


def undated(count):
    return [Images.write(np.zeros((4, 4), dtype=np.float32)) for _ in range(count)]


def written(tmp_path, data, name="log.csv"):
    path = tmp_path / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def run(path, images, **parameters):
    stage = Channels(file=str(path), **parameters)
    stage.check(path)
    return Table.read(stage.run(file_path=path, images=images))


def test_a_machines_export_with_an_offset_that_is_given(tmp_path):
    data = machine_log(LOG, force(LOG - OFFSET), crosshead(LOG - OFFSET))
    table = run(written(tmp_path, data), photographs(), offset=OFFSET, length="60 mm")
    assert table.load == "force"
    np.testing.assert_allclose(table.of("force").values, force(TIMES), atol=2e-3)
    np.testing.assert_allclose(table.of("crosshead").values, crosshead(TIMES), atol=0.02)
    np.testing.assert_allclose(table.of("time").values, TIMES - TIMES[0], atol=1e-9)
    loading = (TIMES > 9) & (TIMES < 27)
    np.testing.assert_allclose(table.of("crosshead_velocity").values[loading], 1.5, atol=1e-3)
    np.testing.assert_allclose(table.of("nominal_strain_rate").values[loading], 1.5 / 60.0, atol=1e-4)
    assert table.of("nominal_strain_rate").unit == "1/s"
    phases = np.array(table.phases)
    assert set(phases[TIMES < 28]) == {"loading"}
    assert set(phases[TIMES > 38]) == {"unloading"}


@pytest.mark.parametrize("offset", [12.4, -7.3])
def test_the_offset_is_found_by_the_motion(tmp_path, offset):
    seconds = np.arange(-10.0, 90.0, 0.2)
    data = machine_log(seconds, force(seconds - offset), crosshead(seconds - offset))
    table = run(written(tmp_path, data), photographs(), offset="auto")
    found = table.summary
    assert found["offset_s"] == pytest.approx(offset, abs=0.1)
    assert abs(found["offset_s"] - offset) < 3.0 * found["u_offset_s"]
    np.testing.assert_allclose(
        table.of("force").values, force(TIMES), atol=0.1 * np.abs(np.gradient(force(LOG), LOG)).max()
    )


def test_photographs_are_looked_at_for_the_motion_alone(tmp_path):
    """Otherwise their times are enough, and they are neither kept for it nor decoded again."""
    path = written(tmp_path, machine_log(LOG + OFFSET, force(LOG), crosshead(LOG)))
    times_alone = [Product("images", {}, one.attrs) for one in photographs(TIMES[::6])]
    assert np.isfinite(run(path, times_alone, offset=OFFSET).of("force").values).any()
    gathers = {offset: Channels(file="log.csv", offset=offset).gathers("images") for offset in ("auto", 0.0, None)}
    assert gathers == {"auto": True, 0.0: False, None: False}


def test_steps_may_stand_in_another_order_than_their_times(tmp_path):
    """A later photograph is the reference, and first: the same offset, force and phase at each."""
    path = written(tmp_path, machine_log(LOG, force(LOG - OFFSET), crosshead(LOG - OFFSET)))
    images = photographs()
    order = [30, *range(30), *range(31, 60)]
    usual, other = (run(path, chosen, offset="auto") for chosen in (images, [images[k] for k in order]))
    assert other.summary["offset_s"] == usual.summary["offset_s"]
    np.testing.assert_array_equal(other.of("force").values, usual.of("force").values[order])
    assert list(other.phases) == [usual.phases[k] for k in order]


def test_a_balances_lines_with_dates_need_no_offset(tmp_path):
    grams = 1000.0 * force(LOG) / 9.80665
    table = run(written(tmp_path, balance_log(LOG, grams)), photographs(start=START), u={"force": "1 g"})
    inside = LOG[-1] > TIMES
    np.testing.assert_allclose(table.of("force").values[inside], force(TIMES)[inside], atol=2e-3)
    np.testing.assert_allclose(table.of("force").u[inside], 9.80665e-3)
    assert table.of("force").unit == "N"


def test_a_loggers_decimal_commas_and_a_clock_that_is_off(tmp_path):
    data = logger_log(LOG + OFFSET, 20.0 + 0.01 * LOG, force(LOG) / 1000.0)
    table = run(written(tmp_path, data), photographs(start=START), offset="auto")
    assert table.summary["offset_s"] == pytest.approx(OFFSET, abs=0.1)
    np.testing.assert_allclose(table.of("force").values, force(TIMES), atol=0.03)
    np.testing.assert_allclose(table.of("temperature").values, 20.0 + 0.01 * TIMES, atol=0.01)
    assert table.of("temperature").unit == "°C"


@pytest.mark.parametrize(
    ("shown", "zone", "utc_offset"),
    [
        (0.0, "", 3600.0),
        (0.0, "+01:00", 3600.0),
        (-3600.0, "Z", 3600.0),
        (0.0, "+01:00", None),
        (7200.0, "+0300", 3600.0),
    ],
)
def test_clocks_of_one_place_agree_whether_they_show_their_time_zone_or_not(tmp_path, shown, zone, utc_offset):
    """Photographs of a clock one hour before UTC, as phones write it, and logs of that place, of UTC and of another."""
    stamps = [datetime.fromtimestamp(START + shown + t, UTC).strftime("%Y-%m-%d %H:%M:%S.%f") + zone for t in LOG]
    rows = [f"{stamp},{force(t):.5f}" for stamp, t in zip(stamps, LOG, strict=True)]
    images = [
        Images.write(np.zeros((4, 4), np.float32), time=START + t - (utc_offset or 0.0), utc_offset=utc_offset)
        for t in TIMES
    ]
    table = run(written(tmp_path, "\n".join(["Time,Force [N]", *rows])), images)
    np.testing.assert_allclose(table.of("force").values, force(TIMES), atol=2e-3)


def test_a_clock_of_another_time_zone_is_refused_with_what_an_hour_is(tmp_path):
    table = written(tmp_path, balance_log(LOG, 100.0 * force(LOG)))
    with pytest.raises(StageError, match=r"begins 3541\.? s after the last photograph .* 3600 s per hour"):
        run(table, photographs(start=START - 3600.0))


def test_times_of_day_belong_to_the_day_of_the_first_photograph(tmp_path):
    rows = [f"10:{15 + int(t) // 60:02d}:{t % 60:06.3f},{force(t - OFFSET):.5f}" for t in LOG]
    path = written(tmp_path, "\n".join(["Time,Force [N]", *rows]))
    table = run(path, photographs(start=START), offset=OFFSET)
    np.testing.assert_allclose(table.of("force").values, force(TIMES), atol=2e-3)
    later = run(path, photographs(start=0.0), offset=OFFSET)
    np.testing.assert_allclose(later.of("force").values, force(TIMES), atol=2e-3)


def test_the_uncertainty_of_the_offset_counts_where_the_load_changes(tmp_path):
    data = machine_log(LOG, force(LOG - OFFSET), crosshead(LOG - OFFSET))
    table = run(written(tmp_path, data), photographs(), offset="auto", u={"force": "0.5 %"})
    u, values = table.of("force").u, table.of("force").values
    resting = TIMES > 52
    np.testing.assert_allclose(u[resting], 0.005 * values[resting], rtol=1e-6)
    slope = np.gradient(force(TIMES), TIMES)[15]
    assert u[15] == pytest.approx(np.hypot(0.005 * values[15], slope * table.summary["u_offset_s"]), rel=0.1)


def test_steps_after_the_end_of_the_log_have_no_value_and_a_warning(tmp_path):
    early = LOG[LOG < 40.0 + OFFSET]
    data = machine_log(early, force(early - OFFSET), crosshead(early - OFFSET))
    path = written(tmp_path, data)
    table = run(path, photographs(), offset=OFFSET)
    values, reasons = table.of("force").values, table.of("force").reasons
    assert np.array_equal(np.isnan(values), early[-1] < TIMES + OFFSET)
    assert reasons[10] == ""
    assert "the log ends" in reasons[-1]
    assert any("log.csv" in text and "force" in text and "ends" in text for text in table.product.warnings)


def test_by_order_and_by_name(tmp_path):
    path = written(tmp_path, "Kraft [N];Weg [mm]\n0,5;1\n1,25;2\n2;4\n")
    table = run(path, undated(3))
    assert table.of("force").values.tolist() == [0.5, 1.25, 2.0]
    path = written(tmp_path, "image,load (kg)\n2,3.5\n0,1.5\n")
    table = run(path, undated(3))
    assert table.steps == ("0", "1", "2")
    np.testing.assert_allclose(table.of("force").values, np.array([1.5, np.nan, 3.5]) * 9.80665)
    assert table.of("force").reasons[1] == "no row of the log has the name of the step"


@pytest.mark.parametrize(
    ("text", "parameters", "message"),
    [
        ("time [s],force [N]\n0,1\n1,2\n", {"columns": {"force": "Load"}}, "no column 'Load'.*time, force"),
        ("time [s],force [N]\n0,1\n1,2\n", {"load": "torque"}, "no channel 'torque', which load names.*force"),
        ("time [s],weg [mm]\n0,1\n1,2\n", {"load": "crosshead"}, "the load, crosshead, is in mm"),
        ("time [s],cycle\n0,1\n1,2\n", {}, "no column with a known unit"),
        ("time [s],force [Nx]\n0,1\n1,2\n", {"columns": {"force": "force [Nx]"}}, "csv:2.*unknown unit 'Nx'.*units"),
        ("time [s],force\n0,1\n1,2\n", {"columns": {"force": "force"}}, "csv:2.*force has no unit"),
        ("time [s],force [N],force [N]\n0,1,2\n1,2,2\n", {"columns": {"force": "force"}}, "2 columns 'force'.*2, 3"),
        ("time [s],force [N]\n0,1\n5,2\n4,3\n", {}, r"csv:4: the time runs backwards, by 1 s"),
        ("force [N]\n1\n2\n", {"join": "time"}, "no column with times"),
        ("time [s],force [N]\n0,1\n1,ab\n", {"columns": {"force": "force"}}, "csv:3: force is 'ab'"),
        ("force [N];weg [mm]\n1,234;2\n2,345;3\n", {}, "csv:2: '1,234' may have a decimal comma"),
    ],
)
def test_what_is_wrong_with_a_log_is_said_before_a_run(tmp_path, text, parameters, message):
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=message):
        Channels(file=str(path), **parameters).check(path)


def test_a_clock_that_was_set_during_the_test_is_named(tmp_path):
    times = np.arange(60.0)
    path = written(tmp_path, machine_log(times + 3600.0 * (times >= 2), times, times))
    dark = [Images.write(np.zeros((4, 4), dtype=np.float32), time=time) for time in (0.0, 1.0, 20.0)]
    reasons = run(path, dark, offset=0.0).of("force").reasons
    assert [*reasons[:2], "a gap at the step, of 3601 s after line 13" in reasons[2]] == ["", "", True]


def test_numbers_of_rows_and_steps_are_compared_before_a_run(tmp_path):
    path = written(tmp_path, "force [N]\n1\n2\n")
    stage = Channels(file=str(path), join="order")
    with pytest.raises(InputError, match="2 rows for 3 steps"):
        stage.agree({path: stage.check(path)}, {}, {"images": ("a", "b", "c")})


def test_clocks_that_cannot_be_joined(tmp_path):
    path = written(tmp_path, machine_log(LOG, force(LOG), crosshead(LOG)))
    with pytest.raises(StageError, match="offset: auto"):
        run(path, photographs())
    with pytest.raises(StageError, match="no times"):
        run(path, undated(3), offset=0.0)
    with pytest.raises(StageError, match=r"ends .* s before the first photograph"):
        run(path, photographs(), offset=1000.0)
    jumping = np.random.default_rng(1).random(LOG.size)
    path = written(tmp_path, machine_log(LOG, jumping, jumping))
    with pytest.raises(StageError, match="do not move alike"):
        run(path, photographs(), offset="auto")


def test_a_step_may_be_named_once(tmp_path):
    path = written(tmp_path, "image,load (kg)\n2,3.5\n0,1.5\n2,1.5\n")
    with pytest.raises(StageError, match="csv:4: names step '2' again"):
        run(path, undated(3))


def test_a_pipeline_with_two_logs_says_which_one_is_meant():
    stages = "{photos: {stage: images, left: a.png}, machine: {stage: channels, file: log.csv}, "
    stages += "balance: {stage: channels, file: log.csv}, total: {stage: deformation, points: null}, "
    text = f"stages: {stages} probes: {{stage: probes, points: {{P: [1, 1]}}}}}}"
    with pytest.raises(ConfigurationError, match=r"probes\.channels: needs channels; name one of machine, balance"):
        wire(parse(text, "pipeline.yaml"))


def test_an_uncertainty_needs_a_unit():
    with pytest.raises(ValueError, match="write a number and a unit"):
        Channels(file="a.csv", u={"force": "some"})
