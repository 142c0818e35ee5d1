"""How exact the measurement is: the five replicas, the two studies, and real photographs where they are at hand.

Run it with ``make accuracy``, or some parts with ``python -m tests.accuracy PART …``. Prints Tables 6–10, 1 and 4, then
every quantity with its bar.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from dicflow.core.cameras.camera import rotation_angle_deg
from dicflow.kinds.rig import rig_from_json
from dicflow.pipeline import Result
from tests import accuracy_material, accuracy_photographs, accuracy_scenes, accuracy_sheets, accuracy_stereo
from tests.accuracy_coverage import coverage
from tests.accuracy_noisy_stars import noisy_stars
from tests.accuracy_planar import planar
from tests.accuracy_rig import bumped_rigs
from tests.accuracy_rigid import rigid_motions
from tests.accuracy_stars import stars
from tests.bars import Figure
from tests.data_folder import SHARED
from tests.figures import ROOT, pipeline_result, print_table, replica, report, run_text
from tests.reference_points import difference


def replicas() -> Iterator[Figure]:
    """The thesis's five experiments; largest error over all 84 steps, in three ways of measuring the length.

    Points that follow the matches around them, as by default; points that follow the transform of their own subset
    alone, as in the thesis; and the length in the clouds between the carried edges, as in the thesis.
    """
    ways = {"": (), ", points by subset": ["track.follow=subset"], ", length of the cloud": ["comparison.length=cloud"]}
    for way, settings in ways.items():
        tables = [
            pipeline_result(f"latex_experiment_{number}", replica(number), f"store_{number}", settings).product(
                "comparison"
            )
            for number in range(1, 6)
        ]
        if not settings:
            for number, table in enumerate(tables, start=1):
                print(f"\nTable {5 + number}: experiment {number}")
                print_table(table.attrs["rows"])
        rows = [row for table in tables for row in table.attrs["rows"]]
        measured = sum(row["dic_length_mm"] is not None for row in rows)
        yield Figure(f"replicas{way}: steps measured", measured, 84, at_least=True)
        for quantity, bar in (("displacement", 3.79), ("strain", 3.66)):
            worst = max(
                np.inf if row[f"{quantity}_error_pct"] is None else abs(row[f"{quantity}_error_pct"]) for row in rows
            )
            yield Figure(f"replicas{way}: largest error in {quantity}", worst, bar, unit="%")


def polynomial_degree() -> Iterator[Figure]:
    """Table 1: SSE and R² of the surface by degree; SSE must not grow in any step."""
    result = pipeline_result("polynomial_degree", ROOT / "data_samples", "store_degree")
    steps = result.steps("surface")
    fits = [[result.product("surface", step, v).attrs["fit"] for step in steps] for v in range(len(result.values))]
    print("\nTable 1: means over the steps, coordinate z")
    for degree, per_step in enumerate(fits, start=1):
        sse, r2 = (np.mean([fit["z"][key] for fit in per_step]) for key in ("sse", "r2"))
        print(f"  degree {degree}: SSE {sse:.6g} mm², R² {r2:.6f}")
    growth = max(
        after[axis]["sse"] / before[axis]["sse"] - 1.0
        for lower, higher in itertools.pairwise(fits)
        for before, after in zip(lower, higher, strict=True)
        for axis in "xyz"
    )
    yield Figure("Table 1: largest relative growth of SSE with the degree", growth, 1e-9)


def detectors() -> Iterator[Figure]:
    """Table 4: features and matches of each detector, means over the step pairs."""
    result = pipeline_result("detectors", ROOT / "data_samples", "store_detectors")
    print("\nTable 4: means over the step pairs")
    for values, row in zip(result.values, result.table(), strict=True):
        counts = {key.removeprefix("matches."): row[key] for key in row if key.startswith("matches.")}
        print(f"  {values['features.detector']:<6}", {key: round(value) for key, value in counts.items()})
        yield Figure(f"Table 4: inliers of {values['features.detector']}", row["track.inliers"])


def d_specimen() -> Iterator[Figure]:
    """A real steel part from its board photographs to its displacement."""
    result = pipeline_result("d_specimen", SHARED / "d_specimen", "store_d")
    rig = rig_from_json(result.product("rig").attrs["rig"])
    truth_t, truth_r = boards_truth()
    yield Figure("d specimen: T, largest component's error", np.abs(rig.translation - truth_t).max(), 0.1, unit="mm")
    yield Figure("d specimen: rotation error", rotation_angle_deg(rig.rotation, truth_r), 0.01, unit="°")
    yield Figure("d specimen: stereo RMS", result.product("rig").attrs["summary"]["rms_px"], 0.05, unit="px")
    against = difference(result, SHARED / "d_specimen")
    yield Figure("d specimen: share of the reference's points covered", against.share)
    for name, mean in zip("UVW", np.abs(against.mean), strict=True):
        yield Figure(f"d specimen: mean {name} against the other program", float(mean), 0.05, unit="mm")


def boards_truth() -> tuple[np.ndarray, np.ndarray]:
    """T [mm] and R of the rig that the boards were rendered with."""
    import xml.etree.ElementTree as ElementTree

    from dicflow.core.cameras.camera import rotation_matrix

    camera = ElementTree.parse(SHARED / "d_specimen/reference/boards_truth.xml").getroot().findall("ParameterList")[1]
    value = {item.get("name"): item.get("value", "") for item in camera.findall("Parameter")}
    turn = np.radians([float(value[name]) for name in ("ALPHA", "BETA", "GAMMA")])
    x, y, z = (rotation_matrix(axis * angle) for axis, angle in zip(np.eye(3), turn, strict=True))
    return np.array([float(value[name]) for name in ("TX", "TY", "TZ")]), z @ y @ x


def board_photographs() -> Iterator[Figure]:
    """Twenty real pairs of board photographs."""
    text = """\
stages:
  boards: {stage: images, left: left/*.tif, right: right/*.tif}
  corners: {stage: corners, images: boards, size: [11, 7]}
  rig: {stage: calibrate, square: 8 mm}
"""
    summary = run_text("boards", text, SHARED / "boards").product("rig").attrs["summary"]
    yield Figure("board photographs: pairs used of 20", summary["pairs_used"], 20, at_least=True)
    yield Figure("board photographs: stereo RMS", summary["rms_px"], 0.13, unit="px")


PLANAR = """\
stages:
  photos: {{stage: images, left: {photos}}}
  region: {{stage: region, images: photos{region}}}
  features: {{stage: features, images: photos}}
  matches: {{stage: match, images: photos}}
  track: {{stage: track, subsets: [4, 2]}}
  increment: {{stage: displacement}}
  smooth: {{stage: smooth, increment: increment}}
  strain: {{stage: strain, increment: smooth}}
  total: {{stage: accumulate}}
  maps: {{stage: maps}}
"""


def sample3() -> Iterator[Figure]:
    """Rigid shifts of 0 to 1 px; the file names are the truth."""
    text = PLANAR.format(photos='["Sample3 Reference.tif", "Sample3-*.tif"]', region=", rectangle: [40, 40, 470, 470]")
    result = run_text("sample3", text, SHARED / "challenge_2d/sample3")
    errors = []
    for step in result.steps("total"):
        truth = float(step.split(" X")[1].split()[0])
        total = result.product("total", step)
        errors += [abs(float(np.nanmean(total[name])) - truth) for name in "UV"]
    yield Figure("sample 3: largest error of the mean shift over all files", max(errors), 0.02, unit="px")


def necking() -> Iterator[Figure]:
    """A real tensile bar up to necking, in one camera."""
    result = run_text("necking", PLANAR.format(photos='"*.tif"', region=""), SHARED / "necking")
    last = result.product("total", -1)
    known = np.isfinite(last["eyy"])
    yield Figure("necking: share of the grid's points alive at the last photograph", alive(result, known))
    yield Figure("necking: largest strain in the neck", float(np.nanmax(last["eyy"])))
    determinant = np.linalg.det(last["gradient"][known])
    yield Figure("necking: least determinant of F, no fold", float(determinant.min()), 0.0, at_least=True)


def alive(result: Result, known: np.ndarray) -> float:
    first = np.isfinite(result.product("track", 0)["points"]).all(axis=-1)
    return float(known.sum() / first.sum())


PARTS: Mapping[str, Callable[[], Iterator[Figure]]] = {
    "replicas": replicas,
    "polynomials": polynomial_degree,
    "detectors": detectors,
    "planar": planar,
    "stars": stars,
    "noisy-stars": noisy_stars,
    "rigid": rigid_motions,
    "bumped": bumped_rigs,
    "coverage": coverage,
    "precise-replicas": accuracy_stereo.replicas,
    "scenes": accuracy_scenes.scenes,
    "material": accuracy_material.material,
    "sheets": accuracy_sheets.sheets,
}
REAL: Mapping[str, Callable[[], Iterator[Figure]]] = {
    "d-specimen": d_specimen,
    "boards": board_photographs,
    "sample3": sample3,
    "necking": necking,
    "published-rubber": accuracy_material.published,
    "precise-d-specimen": accuracy_stereo.d_specimen,
    "rigid-points": accuracy_photographs.rigid_points,
    "precise-necking": accuracy_photographs.necking,
}
"""Parts that need the real photographs."""


def main(names: Sequence[str]) -> int:
    """names : of the parts; without any all that can be measured here"""
    unknown = [name for name in names if name not in (*PARTS, *REAL)]
    if unknown:
        sys.exit(f"no part '{unknown[0]}'; parts: {', '.join((*PARTS, *REAL))}")
    if not SHARED.is_dir():
        print(f"no real photographs in {SHARED}: left out", file=sys.stderr)
    parts = {**PARTS, **REAL} if SHARED.is_dir() else PARTS
    return report(figure for name in names or parts if name in parts for figure in parts[name]())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
