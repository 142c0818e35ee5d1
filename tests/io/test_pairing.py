"""Partners by the names of photographs: all right, or refused."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.errors import InputError
from dicflow.io.images import counter_offset, pair_names

INTERVAL, LAG = 1000, 16
"""Between two photographs of one camera, and from the left to the right camera, in the units of the names' times."""


def timed(side, frames):
    """Names with a frame number and a time that jitters by up to 10."""
    start = {"l": 100_003, "r": 100_003 + LAG}[side]
    return [f"frame_{k:03d}_t{start + INTERVAL * k + 37 * k % 11}.png" for k in frames]


FORMS = {
    "frame number": lambda side, k: f"frame_{k:04d}.png",
    "camera and frame number": lambda side, k: f"cam{'lr'.index(side)}_step{k}.tif",
    "word": lambda side, k: f"{'left' if side == 'l' else 'right'} {k:02d}.jpg",
    "frame number and time": lambda side, k: timed(side, [k])[0],
    "date and time": lambda side, k: f"IMG_20260301_{10 + k // 60:02d}{k % 60:02d}{7 + (side == 'r'):02d}.jpg",
    "time alone": lambda side, k: f"{100_003 + LAG * (side == 'r') + INTERVAL * k + 37 * k % 11}.png",
    "suffix of the camera": lambda side, k: f"test_{k}_{'lr'.index(side)}.bmp",
    "serial number": lambda side, k: f"{'19443' if side == 'l' else '19444'}-{k:06d}.png",
}


@st.composite
def recordings(draw):
    """A form of names, and the frames that the left and the right camera have kept, in any order."""
    form = FORMS[draw(st.sampled_from(sorted(FORMS)))]
    count = draw(st.integers(3, 12))
    left, right = (draw(st.permutations(range(count))) for _ in range(2))
    lost = [draw(st.sets(st.integers(0, count - 1), max_size=count - 2)) for _ in range(2)]
    return form, *([k for k in side if k not in gone] for side, gone in zip((left, right), lost, strict=True))


@pytest.mark.slow
@settings(max_examples=300)
@given(recordings())
def test_either_all_pairs_are_right_or_the_photographs_are_refused(recording):
    form, left, right = recording
    truth = {form("l", k): form("r", k) for k in left if k in right}
    names = [form("l", k) for k in left], [form("r", k) for k in right]
    if sorted(left) == sorted(right):
        assert dict(pair_names(*names).pairs) == truth
    else:
        with pytest.raises(InputError, match="without a partner"):
            pair_names(*names)


@pytest.mark.slow
@settings(max_examples=300)
@given(recordings())
def test_what_is_left_of_skipped_steps_are_right_pairs(recording):
    form, left, right = recording
    truth = {form("l", k): form("r", k) for k in left if k in right}
    names = {"left": [form("l", k) for k in left], "right": [form("r", k) for k in right]}
    partners = {*truth, *truth.values()}
    alone = {f"{side} {name}" for side, given in names.items() for name in given if name not in partners}
    message = ""
    try:
        found = pair_names(*names.values(), unpaired="skip")
    except InputError as refusal:
        message = str(refusal)
    if message:
        assert 2 * len(truth) < max(len(left), len(right)), "refused although most have a partner"
        named = {one for side, given in names.items() for name in given if (one := f"{side} {name}") in message}
        assert named <= alone
        assert len(named) == min(len(alone), 5)
        assert "unpaired: skip" not in message
        return
    assert dict(found.pairs) == truth
    assert set(found.alone) == alone


def test_photographs_that_each_camera_lost_are_named():
    left, right = timed("l", [0, 1, 3, 4, 5, 6, 7]), timed("r", [0, 1, 2, 3, 4, 6, 7])
    with pytest.raises(InputError, match=r"left frame_005_\S+ right frame_002_\S+ .*unpaired: skip") as refusal:
        pair_names(left, right)
    assert "order" not in str(refusal.value), "by order the pairs would be wrong"
    found = pair_names(left, right, unpaired="skip")
    assert (
        [a[6:9] for a, _ in found.pairs]
        == [b[6:9] for _, b in found.pairs]
        == ["000", "001", "003", "004", "006", "007"]
    )


def test_milliseconds_after_a_sign_belong_to_the_time():
    left, right = (
        [f"{side}_20260301_1000{5 * k:02}_{ms}.png" for k, ms in enumerate(fractions)]
        for side, fractions in (("L", (250, 111, 106, 180, 320, 140)), ("R", (190, 230, 310, 106, 111, 205)))
    )
    assert dict(pair_names(left, right).pairs) == dict(zip(left, right, strict=True))


def test_counters_that_hide_a_lost_photograph_are_refused_by_the_times():
    left = [f"f{k}_t{100_003 + INTERVAL * frame}.png" for k, frame in enumerate([0, 1, 3, 4, 5])]
    right = [f"f{k}_t{100_019 + INTERVAL * frame}.png" for k, frame in enumerate([0, 1, 2, 3, 5])]
    with pytest.raises(InputError, match=r"disagree from f2_t103003\.png and f2_t102019\.png on"):
        pair_names(left, right)
    assert len(pair_names(left, right, by="name").pairs) == 5
    assert [a[:2] + b[:2] for a, b in pair_names(left, right, by="time", unpaired="skip").pairs] == [
        "f0f0",
        "f1f1",
        "f2f3",
        "f4f4",
    ]


def test_clocks_that_differ_by_a_constant_do_not_contradict_the_numbers():
    left = [f"f{k}_{5_000_000 + INTERVAL * k}.png" for k in range(6)]
    right = [f"f{k}_{9_000_700 + INTERVAL * k}.png" for k in range(6)]
    assert [(a[1], b[1]) for a, b in pair_names(left, right).pairs] == [(str(k), str(k)) for k in range(6)]


@pytest.mark.parametrize("offset", [1, 776])
def test_counters_that_start_elsewhere_are_paired_by_order_only_if_asked(offset):
    left = [f"IMG_{k:04d}.jpg" for k in range(100, 105)]
    right = [f"IMG_{k + offset:04d}.jpg" for k in range(100, 105)]
    with pytest.raises(
        InputError,
        match=f"pair_by: order if no photograph is missing on either side: their counters are {offset} apart",
    ):
        pair_names(left, right)
    assert counter_offset(left, right) == offset
    assert pair_names(left, right, by="order").pairs == tuple(zip(left, right, strict=True))


def test_times_too_far_apart_have_no_partner():
    left = [f"2026-03-01T10-15-{second:02d}.png" for second in (0, 4, 8, 12)]
    near = [f"2026-03-01T10-15-{second:02d}.png" for second in (1, 5, 9, 13)]
    far = [f"2026-03-01T10-15-{second:02d}.png" for second in (2, 6, 10, 14)]
    assert pair_names(left, near).by == "time"
    with pytest.raises(InputError, match="without a partner"):
        pair_names(left, far)


def test_names_without_numbers_are_paired_by_what_they_share_then_by_order():
    assert pair_names(["left_after.png", "left_before.png"], ["right_before.png", "right_after.png"]).pairs == (
        ("left_after.png", "right_after.png"),
        ("left_before.png", "right_before.png"),
    )
    assert pair_names(["a.png", "b.png"], ["x.png", "y.png"]).by == "order"
    with pytest.raises(InputError, match=r"left a\.png, right c\.png"):
        pair_names(["a.png", "b.png"], ["b.png", "c.png"])


def test_two_numbers_that_both_fit_and_disagree_are_refused():
    with pytest.raises(InputError, match="by one number in its name"):
        pair_names(["1_20.png", "2_10.png"], ["1_10.png", "2_20.png"])


def test_another_number_of_photographs_cannot_be_paired_by_order():
    with pytest.raises(InputError, match="2 left and 3 right photographs cannot be paired by their order"):
        pair_names(["a1.png", "a2.png"], ["b5.png", "b6.png", "b7.png"], by="order")
