"""A result as manifest and blobs: numbers of the products, what is left out, and pieces that are kept."""

from __future__ import annotations

import json
from base64 import b64decode

import numpy as np
import pytest

from dicflow.core.status import Status
from dicflow.explorer.content import select, spread
from dicflow.explorer.outside import Outside
from dicflow.explorer.pack import pack
from dicflow.explorer.packing import LinearScale, LogScale, unpacked
from dicflow.explorer.page import fragment, script
from dicflow.explorer.survey import scales_of, survey
from tests.explorer.waves import Waves, reading_of
from tests.pages import Page


def made(sources, make):
    return make()


def packed_waves(budget_bytes=7e6, **options):
    return pack(reading_of(Waves(**options)), "waves", made, budget_bytes)


def numbers(found, step, key):
    return unpacked(found.blobs[step["blobs"][key]], tuple(step["shape"]))


@pytest.mark.parametrize("place", [0, 3])
def test_values_deviations_and_reasons_are_those_of_the_product(place):
    found, waves = packed_waves(), Waves()
    step, truth = found.manifest["steps"][place], waves.read(waves.steps[place])
    for entry in found.manifest["quantities"]:
        scale = LinearScale(*entry["scale"])
        back = scale.values(numbers(found, step, f"value/{entry['name']}"))
        expected = truth.values[entry["name"]]
        assert (np.isnan(back) == np.isnan(expected)).all()
        assert np.nanmax(np.abs(back - expected)) <= scale.quantum / 2 * (1 + 1e-9)
    strain = found.manifest["quantities"][0]
    assert [*truth.errors] == ["u", "sigma", "bias", "share"]
    for part, arrays in truth.errors.items():
        scale = LogScale(*strain["errors"][part])
        back = scale.values(numbers(found, step, f"{part}/exx"))
        assert (np.isnan(back) == np.isnan(arrays["exx"])).all()
        assert np.nanmax(np.abs(back / arrays["exx"] - 1)) <= scale.error * (1 + 1e-5)
    assert (numbers(found, step, "status") == truth.status).all()


def test_places_are_within_half_a_quantum_and_lost_points_have_none():
    found, waves = packed_waves(), Waves()
    step, truth = found.manifest["steps"][1], waves.read(waves.steps[1])
    for place, expected in truth.places.items():
        scales = found.manifest["places"][place]
        codes = unpacked(found.blobs[step["blobs"][f"place/{place}"]], expected.shape)
        back = np.stack([LinearScale(*scale).values(codes[..., k]) for k, scale in enumerate(scales)], axis=-1)
        assert (np.isnan(back) == np.isnan(expected)).all()
        assert (
            np.nanmax(np.abs(back - expected), axis=(0, 1)) <= [quantum / 2 * (1 + 1e-6) for _, quantum in scales]
        ).all()


def test_the_first_view_is_the_step_of_largest_mean_strain():
    assert packed_waves().manifest["main"] == ("exx", 3)


def test_means_and_counts_are_those_of_the_field():
    found, waves = packed_waves(), Waves()
    values = waves.read(waves.steps[2]).values["exx"]
    assert found.manifest["quantities"][0]["means"][2] == pytest.approx((np.nanmean(values), np.nanstd(values)))
    step = found.manifest["steps"][2]
    lost = len(range(0, 40, 7))
    assert step["counts"] == {"0": 1200 - lost, str(int(Status.HIDDEN)): lost}
    assert step["valid"] == pytest.approx(1 - lost / 1200)


def test_every_reason_has_the_sentence_that_defines_it():
    reasons = {one["code"]: one for one in packed_waves().manifest["reasons"]}
    assert reasons.keys() == {int(code) for code in (*Status, *Outside)}
    assert reasons[Status.HIDDEN]["sentence"] == "Not visible in the other camera."
    assert reasons[Status.VALID]["sentence"] == "Measured."


@pytest.mark.parametrize(
    ("budget", "quantities", "stride", "steps"), [(1e9, 5, 1, 10), (3500, 4, 1, 10), (1900, 5, 2, 10), (300, 4, 2, 3)]
)
def test_a_page_leaves_out_quantities_then_points_then_steps(budget, quantities, stride, steps):
    blobs = {
        "status": b"0" * 10,
        **{f"value/{name}": b"0" * 50 for name in "abcde"},
        **{f"sigma/{name}": b"0" * 20 for name in "abcde"},
    }
    found = select(blobs, list("abcde"), [str(k) for k in range(10)], budget)
    assert (len(found.quantities), found.stride, len(found.steps)) == (quantities, stride, steps)
    assert found.quantities == list("abcde")[:quantities]
    size = 1.1 * (10 + 70 * quantities)
    assert steps * size / stride**2 <= budget


def test_what_is_left_out_is_said():
    found = packed_waves(budget_bytes=9e3, count=6)
    stated = " ".join(found.manifest["left_out"])
    assert "every second point" in stated
    assert found.manifest["steps"][0]["shape"] == (15, 20)
    assert packed_waves().manifest["left_out"] == []


def test_steps_are_spread_from_the_first_to_the_last():
    steps = [f"step_{number}" for number in range(500)]
    shown = spread(steps, 40)
    assert len(set(shown)) == 40
    assert (shown[0], shown[-1]) == (steps[0], steps[-1])
    assert spread(steps[:3], 40) == steps[:3]
    assert spread(steps[:1], 40) == steps[:1]
    assert spread([], 40) == []


def test_a_second_page_packs_nothing():
    kept = {}
    waves = Waves()
    first = pack(reading_of(waves), "waves", lambda sources, make: kept.setdefault(json.dumps(sources), make()), 7e6)

    def only_kept(sources, make):
        return kept[json.dumps(sources)]

    assert pack(reading_of(waves), "waves", only_kept, 7e6) == first


def test_a_step_without_any_value_does_not_widen_the_scales():
    waves = Waves()
    whole = survey(waves.read(waves.steps[0]), None)
    empty = survey(waves.read(waves.steps[0])._replace(values={"exx": np.full((30, 40), np.nan)}, errors={}), None)
    assert scales_of([whole, empty], None).values == scales_of([whole], None).values


def test_names_of_others_close_no_element_and_the_data_are_whole():
    found = packed_waves()
    html = fragment(found)
    page = Page(f"<html><body>{html}</body></html>")
    assert "<b>" not in html
    assert not [text for text in page.references if not text.startswith("data:")]
    manifest = json.loads(html.split('id="explorer-manifest">')[1].split("</script>")[0])
    blobs = json.loads(html.split('id="explorer-blobs">')[1].split("</script>")[0])
    assert manifest["quantities"][2]["title"] == "</script><b>a name of a plug-in"
    assert {name: b64decode(text) for name, text in blobs.items()} == dict(found.blobs)


def test_the_modules_make_one_script_in_which_no_name_occurs_twice():
    import re

    text = script()
    assert not re.findall(r"^(?:import|export) ", text, re.MULTILINE)
    names = re.findall(r"^(?:async )?(?:function\*?|class|const|let) (\w+)", text, re.MULTILINE)
    assert len(names) == len(set(names)), sorted(name for name in names if names.count(name) > 1)
