import numpy as np
import pytest
from left_camera import correlation, grid
from stereo_scene import REST, State, left_truth, material, photographs, right_truth

from dicflow.core.correlation.across import (
    PointsInStep,
    contrast,
    follow_across,
    grid_mask,
    inherited_covariance,
    noise_ratio,
    overexposed_share,
    starts_agree,
    starts_from_previous_step,
)
from dicflow.core.correlation.judgement import find_points
from dicflow.core.correlation.points import ReferencePhotograph
from dicflow.core.correlation.search import Search, first_photograph, target_spline
from dicflow.core.correlation.subsets import Subset
from dicflow.core.correlation.warp import warp_from_gradient
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.tensors import congruent

SUBSET = Subset(31, "quadratic")
SEARCH = Search(SUBSET, noise=0.5)
TURNED = State(curl=0.3, turn=(0.1, 0.05, 0.2), shift=(0.3, 0.2, -2.0))
STRETCHED = State(stretch=1.05, bulge=-0.2, curl=0.3, turn=(0.05, 0.1, 0.03), shift=(0.5, 0.3, -1.0))
POINTS = grid((200, 150, 400, 350), 25).astype(float)
MATERIAL = material(POINTS)
LEFT, BETWEEN = photographs(REST, 0.5), photographs(TURNED, 0.5, 1)


def starts(state=REST, points=POINTS):
    places = right_truth(material(points), state)
    slopes = [
        right_truth(material(points + s), state) - right_truth(material(points - s), state) for s in 0.5 * np.eye(2)
    ]
    return warp_from_gradient(places + 0.5, np.stack(slopes, axis=-1))


def first():
    return first_photograph(Photograph(LEFT[0]), np.ones(LEFT[0].shape, dtype=bool), POINTS, SEARCH)


def between():
    step = correlation(LEFT[0], BETWEEN[0], POINTS, left_truth(MATERIAL, TURNED))
    everywhere = np.ones(LEFT[0].shape, dtype=bool)
    warp = step["warp"][..., :3]
    return ReferencePhotograph(
        Photograph(BETWEEN[0]), (0, 0), everywhere, step["xy"], warp, step["passed"], step["slope"]
    )


def routes(value):
    return np.full(POINTS.shape[:2], value, dtype=np.uint8)


@pytest.mark.slow
def test_points_of_either_reference_are_found_at_the_same_place():
    target, truth = target_spline(Photograph(BETWEEN[1]), SEARCH), right_truth(MATERIAL, TURNED)
    direct = follow_across(first(), between(), routes(1), target, starts(TURNED), SEARCH)
    chained = follow_across(first(), between(), routes(2), target, starts(TURNED), SEARCH)
    mixed = routes(1)
    mixed[::2] = 2
    both = follow_across(first(), between(), mixed, target, starts(TURNED), SEARCH)
    for found in (direct, chained, both):
        assert found.valid.all()
        assert found.warp.shape == (*POINTS.shape[:2], 2, 6)
        assert np.abs(found.warp[..., 0] - truth).max() < 0.012
    np.testing.assert_array_equal(both.route, mixed)
    expected = np.where((mixed == 2)[..., None], chained.warp[..., 0], direct.warp[..., 0])
    np.testing.assert_allclose(both.warp[..., 0], expected, atol=1e-3)


def test_points_without_a_place_in_the_reference_step_are_found_with_the_first_photograph():
    photograph = between()
    part = photograph._replace(points=np.where((np.arange(POINTS.shape[1]) < 3)[:, None], np.nan, photograph.points))
    found = follow_across(
        first(), part, routes(2), target_spline(Photograph(BETWEEN[1]), SEARCH), starts(TURNED), SEARCH
    )
    assert found.valid.all()
    np.testing.assert_array_equal(found.route[0], [1, 1, 1, *[2] * (POINTS.shape[1] - 3)])


def test_covariance_is_that_of_the_right_photograph_alone_by_either_route():
    target = target_spline(Photograph(BETWEEN[1]), SEARCH)
    direct, chained = (
        follow_across(first(), between(), routes(route), target, starts(TURNED), SEARCH).covariance for route in (1, 2)
    )
    assert 0.85 < np.median(chained / direct, axis=(0, 1))[[0, 2]].min() < 1.15


def test_points_without_a_start_or_a_place_have_no_value():
    begin, photograph = starts(), first()
    begin[:3] = np.nan
    hidden = photograph._replace(points=np.where((np.arange(POINTS.shape[1]) < 2)[:, None], np.nan, photograph.points))
    found = follow_across(hidden, None, routes(0), target_spline(Photograph(LEFT[1]), SEARCH), begin, SEARCH)
    assert not found.valid[:, :2].any()
    assert found.valid[:, 2:].all()  # grown from the neighbours


def test_starts_from_the_previous_step_follow_the_left_photograph():
    """The surface moves in itself, so the left photograph's motion times the slope across is the right one's."""
    generator = np.random.default_rng(0)
    shape = (4, 5)
    across, left_gradient = np.array([[0.9, 0.1], [0.0, 1.1]]), generator.normal(np.eye(2), 0.1, (*shape, 2, 2))
    before, motion = generator.uniform(0, 500, (*shape, 2)), generator.uniform(-9, 9, (*shape, 2))
    after_gradient = generator.normal(np.eye(2), 0.1, (*shape, 2, 2))
    right = PointsInStep(before @ across.T + [3.0, 4.0], across @ left_gradient)
    start = starts_from_previous_step(
        PointsInStep(before + motion, after_gradient), PointsInStep(before, left_gradient), right
    )
    np.testing.assert_allclose(start[..., 0], (before + motion) @ across.T + [3.0, 4.0])
    np.testing.assert_allclose(start[..., 1:], across @ after_gradient)


def test_starts_agree_with_the_grey_levels_or_not():
    begin = starts()
    assert starts_agree(LEFT[0], LEFT[1], POINTS, begin)
    assert not starts_agree(LEFT[0], LEFT[1], POINTS, begin + np.array([[9.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    begin[2:] = np.nan
    assert not starts_agree(LEFT[0], LEFT[1], POINTS, begin)


def test_noise_ratio_of_the_cameras():
    generator = np.random.default_rng(2)
    left = np.rint(LEFT[0] + generator.normal(0.0, 2.0, LEFT[0].shape))
    right = np.rint(LEFT[1] + generator.normal(0.0, 4.0, LEFT[1].shape))
    places = right_truth(MATERIAL, REST)
    places[0, :2] = np.nan
    ratio = noise_ratio(left, right, POINTS, places)
    assert ratio == pytest.approx(2.0, rel=0.1)
    assert noise_ratio(left, right, POINTS, places + np.nan) == 1.0


def test_noise_of_the_right_photograph_changes_only_its_covariance():
    target = target_spline(Photograph(BETWEEN[1]), SEARCH)
    one, two = (
        follow_across(first(), None, routes(1), target, starts(TURNED), SEARCH._replace(target_noise_ratio=s))
        for s in (1.0, 2.0)
    )
    np.testing.assert_allclose(two.covariance, 4.0 * one.covariance)
    np.testing.assert_allclose(two.template_covariance, one.template_covariance)


def test_contrast_is_the_spread_of_grey_levels():
    image = np.tile([[10, 30]], (4, 3)).astype(np.uint8)
    assert contrast(image, np.array([[0.2, 1.0], [0.9, 2.1], [np.nan, 0.0]])) == 10.0
    assert contrast(image, np.array([[0.2, 1.0], [0.9, 2.1], [-4.0, 0.0], [0.0, 99.0]])) == 10.0
    assert contrast(image, np.full((2, 2), np.nan)) == 1.0
    assert contrast(image, np.array([[0.0, 0.0], [2.0, 2.0]])) == 1.0


def test_overexposed_places():
    image = np.full((20, 30), 90, dtype=np.uint8)
    image[:, 15:] = 255
    places = np.stack(np.meshgrid(np.arange(0.0, 40.0, 5.0), [4.0, 9.0]), axis=-1)
    assert overexposed_share(image, places) == pytest.approx(0.5)
    places[0, 0] = np.nan
    assert overexposed_share(image, places) == pytest.approx(6 / 11)
    assert np.isnan(overexposed_share(image, places + 100.0))


def test_grid_mask_has_the_pixels_between_places():
    places = np.stack(np.meshgrid([4.0, 10.0, 16.0], [3.0, 8.0]), axis=-1)
    inside = grid_mask((12, 20), places)
    assert inside.sum() == 13 * 6
    places[0, 2] = np.nan
    assert grid_mask((12, 20), places).sum() == 7 * 6


def test_little_of_the_matched_noise_is_inherited():
    """Where a subset looks the same in the right photograph nothing of it remains; where it shrinks, some of it."""
    shift = warp_from_gradient(POINTS + 0.3, np.broadcast_to(np.eye(2), (*POINTS.shape, 2)))
    matched = follow_across(first(), None, routes(1), target_spline(Photograph(LEFT[0]), SEARCH), shift, SEARCH)
    assert (np.abs(inherited_covariance(matched, SEARCH)) < 1e-3 * matched.covariance[..., :1]).all()
    across = follow_across(first(), None, routes(1), target_spline(Photograph(LEFT[1]), SEARCH), starts(), SEARCH)
    remains = (inherited_covariance(across, SEARCH) / across.covariance)[..., [0, 2]]
    assert (remains > 0.0).all()
    assert np.median(remains) < 0.3


@pytest.mark.parametrize("route", ["direct", "chained"])
def test_sigma_covers_the_errors_of_places_followed_from_a_match(route):
    """By the noise of the left photograph, of the right one that was matched, of one in between, and of the last."""
    noise, fine = 4.0, grid((150, 90, 450, 410), 20).astype(float)
    search, everywhere = SEARCH._replace(noise=np.hypot(noise, 12**-0.5)), np.ones(LEFT[0].shape, dtype=bool)
    truth = [right_truth(material(fine), state) for state in (REST, TURNED, STRETCHED)]
    begin = [starts(state, fine) for state in (REST, TURNED, STRETCHED)]
    sizes = []
    for run in range(5):
        views = [photographs(state, noise, 10 * run + k) for k, state in enumerate((REST, TURNED, STRETCHED))]
        photograph, target = (
            first_photograph(Photograph(views[0][0]), everywhere, fine, search),
            target_spline(Photograph(views[2][1]), search),
        )
        match = follow_across(
            photograph,
            None,
            np.ones(fine.shape[:2], np.uint8),
            target_spline(Photograph(views[0][1]), search),
            begin[0],
            search,
        )
        reference = ReferencePhotograph(
            Photograph(views[0][1]),
            (0, 0),
            everywhere,
            match.warp[..., 0],
            match.warp,
            inherited_covariance(match, search),
            match.slope,
        )
        if route == "chained":
            step = find_points(reference, target_spline(Photograph(views[1][1]), search), begin[1], search)
            reference = ReferencePhotograph(
                Photograph(views[1][1]),
                (0, 0),
                everywhere,
                step.warp[..., 0],
                step.warp,
                step.inherited_covariance,
                step.slope,
            )
        found = find_points(reference, target, begin[2], search, route=1 + (route == "chained"))
        covariance = found.covariance + congruent(found.warp[..., 1:3], match.template_covariance)
        sizes.append(np.abs(found.warp[..., 0] - truth[2]) / np.sqrt(covariance[..., [0, 2]]))
    sizes = np.array(sizes)
    assert np.mean(sizes < 1.0) == pytest.approx(0.683, abs=0.03)
    assert np.mean(sizes < 2.0) == pytest.approx(0.954, abs=0.02)
