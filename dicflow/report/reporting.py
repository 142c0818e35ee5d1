"""What a report of a measurement must state, filled in from the settings and from what was measured.

The rows follow what the iDICs Good Practices Guide for Digital Image Correlation asks a report for. What no photograph
and no setting states comes from the pipeline file's section ``report``, or is left for the user.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from dicflow._version import __version__
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.correlation import Correlation
from dicflow.kinds.images import Images
from dicflow.kinds.kind import summary_of
from dicflow.kinds.noise_floor import NoiseFloorTable
from dicflow.kinds.quantities import BASIC, QUANTITIES, STRAINS, UNCERTAINTY, strain_measure, unit_of
from dicflow.kinds.region import Region
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.total import Total, named_with_unit
from dicflow.pipeline.result import ArrayFacts, Result
from dicflow.report.calibration import calibrated_stage
from dicflow.report.context import Context
from dicflow.report.measured import cameras, pattern, stand_off_mm

if TYPE_CHECKING:
    from dicflow.engine.product import Product

__all__ = ["Row", "reporting_rows"]

_DIRECTIONS = {
    "material": "x and y of the material, as they lay at the first step",
    "global": "x and y of the coordinate system",
}
_MATCHES = {
    "every_step": "matched with the left subsets at every step",
    "first_step": "matched with the left subsets at the first step, followed in time from there",
}
_REFERENCES = {
    "never": "the first photograph",
    "on_demand": "the first photograph; another where too many points get lost",
    "every": "the first photograph; another, new every {steps} steps, where too many points get lost",
}


class Row(NamedTuple):
    """One row of the table.

    value : None where the user must fill it in
    hint : what belongs there, or where the value comes from
    """

    group: str
    name: str
    value: str | None
    hint: str = ""


_Rows = Iterator[tuple[str, str | None, str]]


def reporting_rows(context: Context) -> list[Row]:
    """The whole table, of the first variant."""
    facts = _Facts(context)
    groups: tuple[tuple[str, Callable[[_Facts], _Rows]], ...] = (
        ("Test", _test),
        ("Cameras and lenses", _cameras),
        ("Stereo system and calibration", _stereo_system),
        ("Specimen and pattern", _pattern),
        ("Software", _software),
        ("Correlation", _correlation),
        ("Tracking and surface", _tracking),
        ("Displacement and strain", _strain),
        ("Uncertainty", _uncertainty),
    )
    return [Row(group, name, value, hint) for group, rows in groups for name, value, hint in rows(facts)]


class _Facts:
    """Settings and products by type of stage and kind of product; missing ones are empty."""

    def __init__(self, context: Context) -> None:
        self.result, resolved = context.result, context.pipeline.resolved()
        self.stated = context.pipeline.facts
        self._settings = {
            resolved["stages"][instance]["stage"]: resolved["stages"][instance]
            for instance in resolved["instances"][0].values()
        }
        total = self.product("total")
        rigs = [stage for stage in self.result.stages_of("rig") if self.result.has(stage)]
        self.rig: CalibratedRig | None = None
        self.figures: Mapping[str, Any] = {}
        if rigs:
            self.rig, self.figures = _rig(context, rigs[-1])
        self.total = None if total is None else Total.read(total)
        self.cameras = cameras(context, rigs[-1]) if rigs else None
        self.photograph = self._photograph()
        self.pattern = pattern(context) or {}
        self.stand_off_mm = stand_off_mm(context)

    def of(self, stage: str) -> Mapping[str, Any]:
        """Parameters of a stage of this type."""
        found: Mapping[str, Any] = self._settings.get(stage, {})
        return found

    def product(self, kind: str, *, last: bool = False) -> Product | None:
        """The first or last product of a kind in the store, of the last stage that gives it."""
        for stage in reversed(self.result.stages_of(kind)):
            steps = self.result.steps(stage) or (None,)
            there = [step for step in steps if self.result.has(stage, step)]
            if there:
                return self.result.product(stage, there[-1 if last else 0])
        return None

    def _photograph(self) -> ArrayFacts | None:
        """The image that the region was drawn in."""
        for region in self.result.stages_of("region"):
            images = self.result.source(region, "images")
            if self.result.has(images, 0):
                return self.result.arrays(images, 0)["left"]
        return None

    @property
    def notes(self) -> Mapping[str, str]:
        """Left or right → what people need to know about the first photographs of the specimen."""
        taken = self.result.stages_of("images")
        for region in self.result.stages_of("region"):
            images = self.result.source(region, "images")
            stage = images if images in taken else self.result.source(images, "images")
            if self.result.has(stage, 0):
                return Images.read(self.result.product(stage, 0)).notes
        return {}

    @property
    def size_px(self) -> tuple[int, int] | None:
        """Width and height of the photographs."""
        if self.cameras is not None:
            return self.cameras.size
        if self.photograph is None:
            return None
        height, width = self.photograph.shape
        return width, height

    @property
    def scale(self) -> float | None:
        """Pixels per mm on the specimen at the first step, by focal length and distance."""
        if self.stand_off_mm is None or self.cameras is None:
            return None
        return self.cameras.focal_px[0] / self.stand_off_mm


def _test(facts: _Facts) -> _Rows:
    for name in ("laboratory", "operator", "remark"):
        if (value := getattr(facts.stated, name)) is not None:
            yield name, value, ""


def _cameras(facts: _Facts) -> _Rows:
    size, scale = facts.size_px, facts.scale
    two = bool(facts.of("images").get("right")) and "undistort" not in facts._settings
    yield "number of cameras", "2" if two else "1", ""
    yield "cameras", facts.stated.camera, "maker and model, sensor and its pixel size"
    yield "image size", _text(size, "{0[0]} × {0[1]} px"), "width × height"
    yield "grey levels", _bits(facts.photograph), "as the photographs are stored"
    for side, note in facts.notes.items():
        yield f"orientation, {side}", note, "by the tag of the first photograph"
    yield "lenses", facts.stated.lens, "maker and model, focal length in mm, filters"
    yield "focal length", _focal(facts), "by calibration, left and right"
    yield "aperture", facts.stated.aperture, "f-number"
    yield "field of view", _view(size, scale), "measured, at the specimen's median distance"
    yield "image scale", _text(scale, "{:.3f} px/mm"), "measured, at the specimen's median distance"
    yield "stand-off distance", _text(facts.stand_off_mm, "{:.1f} mm"), "measured: median depth of the first step"
    yield "exposure time", facts.stated.exposure, "ms, and how the cameras were triggered"
    yield "image acquisition rate", facts.stated.rate, "Hz, or when each photograph was taken"
    yield "lighting", facts.stated.light, "kind and place of the lamps, polarisers"
    yield "number of steps", _steps(facts.result), ""


def _rig(context: Context, stage: str) -> tuple[CalibratedRig, Mapping[str, Any]]:
    """The rig as it was calibrated, and its figures as far as it was not refined, with those of the refined one.

    stage : of the rig that the other stages take
    """
    calibrated, used = (
        CalibratedRig.read(context.result.product(name)) for name in (calibrated_stage(context, stage), stage)
    )
    return calibrated, {**calibrated.summary, **used.summary}


def _stereo_system(facts: _Facts) -> _Rows:
    if not facts.result.stages_of("rig"):
        return
    figures, chosen = facts.figures, facts.of("calibrate")
    yield "stereo angle", _text(figures.get("angle_deg"), "{:.2f}°"), "between the optical axes, by calibration"
    yield "baseline", _text(figures.get("baseline_mm"), "{:.2f} mm"), "distance of the cameras, by calibration"
    if not chosen:
        yield "calibration", None if facts.rig is None else facts.rig.program, "read from a file of this program"
        return
    pairs = () if facts.rig is None else facts.rig.pairs
    used = sum(pair["used"] for pair in pairs)
    model = f"pinhole, {chosen['radial']} radial coefficients" + (", tangential" if chosen["tangential"] else "")
    yield "calibration target", _target(facts, chosen["square"]), "kind, size, spacing"
    yield "pairs of photographs", f"{used} used of {len(pairs)}" if pairs else "none yet", ""
    yield "camera model", model, ""
    yield "reprojection error", _text(figures.get("rms_px"), "{:.3f} px"), "root mean square"
    yield "epipolar error", _text(figures.get("epipolar_px"), "{:.3f} px"), "of the board's corners"


def _target(facts: _Facts, square_mm: float) -> str:
    product = facts.product("corners")
    if product is None:
        return f"not yet seen; spacing {square_mm:g} mm"
    board = BoardMarks.read(product).board
    return f"{board.target}, {board.size[0]} × {board.size[1]}, {square_mm:g} mm"


def _pattern(facts: _Facts) -> _Rows:
    region = facts.product("region")
    yield "specimen", facts.stated.specimen, "geometry, surface"
    yield "material", facts.stated.material, "of the specimen"
    yield "patterning technique", facts.stated.pattern, "paint, print, stencil, …"
    yield (
        "pattern feature size",
        _speckles(facts.pattern.get("size_px"), facts.scale),
        "measured in the first photograph",
    )
    gradient = _text(facts.pattern.get("gradient"), "{:.1f} grey levels of 255 per px")
    yield "mean intensity gradient", gradient, "measured"
    area = None if region is None else Region.read(region).area_px
    yield "region of interest", _text(area, "{:.0f} px²"), "measured"


def _software(facts: _Facts) -> _Rows:
    yield "program", f"dicflow {__version__}", ""
    method = "subset correlation" if facts.of("correlate") else "feature tracking and semi-global matching"
    yield "method", method, "the pipeline is written out under Provenance"


def _correlation(facts: _Facts) -> _Rows:
    chosen, stereo = facts.of("correlate"), facts.of("stereo")
    if not chosen:
        return
    right = f"{stereo['shape_function']} from left to right" if stereo else ""
    in_time = chosen["shape_function"].replace("auto", "affine or, where needed, quadratic")
    shape = f"{in_time} in time" + (f", {right}" if right else "")
    reference = chosen["reference"]
    start = "features and their matches" if facts.of("match") else "cross-correlation"
    yield "image filter", _filter(chosen["smoothing"]), ""
    yield "subset size", f"{chosen['subset_size']} px", ""
    yield "subset weight", _weight(chosen["gaussian"]), ""
    yield "step size", f"{chosen['step_size']} px", ""
    yield "subset shape function", shape, ""
    yield "matching criterion", "zero-mean normalised sum of squared differences (ZNSSD)", ""
    yield "limit of the criterion", f"ZNSSD {chosen['max_znssd']:g}", "points that fit worse have no value"
    yield "interpolant", f"{chosen['interpolation']} spline", ""
    yield "reference image", _REFERENCES[reference["update"]].format(**reference), ""
    if stereo:
        yield "points in the right photographs", _MATCHES[stereo["match"]], ""
    yield "start values", start, ""


def _tracking(facts: _Facts) -> _Rows:
    track, disparity, surface = facts.of("track"), facts.of("disparity"), facts.of("surface")
    if not track:
        return
    grid, features = track["subsets"], facts.of("features")
    yield "features", f"{features['detector']}, at most {features['max_features']}" if features else None, "detector"
    yield "tracked parts", f"{grid[0]} × {grid[1]}, {track['transform']} transforms", "rows × columns over the region"
    yield "step size", f"{track['step_size']:g} px", "distance of the material points"
    yield "reference image", "the step before", "displacements are added up"
    if disparity:
        sides = f"{disparity['window']} px, refined over {disparity['refine']} px"
        yield "stereo matching window", sides, "semi-global matching, sub-pixel refinement"
        yield "limit of the criterion", f"correlation {disparity['correlation']:g}", "of the refinement"
    if surface:
        yield "surface", _surface(surface), "fitted to the point cloud of each step"


def _strain(facts: _Facts) -> _Rows:
    precise, thesis, smooth = facts.of("deformation"), facts.of("strain"), facts.of("smooth")
    measures: Mapping[str, str] = {} if facts.total is None else facts.total.titles
    named = "; ".join(measures[name] for name in STRAINS if name in measures)
    measure = strain_measure(precise["measure"]) if precise else None
    described = f"{measure.title}: {measure.definition}" if measure else named
    yield "strain measure", described or "not yet computed", ""
    if precise:
        yield "strain directions", _DIRECTIONS[precise["directions"]], ""
    frame = facts.of("frame")
    yield "coordinate system", f"frame: {frame['method']}" if frame else _axes(facts), ""
    if smooth:
        yield "displacement filter", _window(smooth), "local polynomial"
    for chosen in (part for part in (thesis, precise) if part):
        yield "strain window", _window(chosen), "local polynomial of the displacement"
    if thesis:
        yield "virtual strain gauge (VSG)", "not defined without subsets: see the windows above", ""
    if precise:
        gauge = None if facts.total is None else facts.total.gauge
        size = "not yet computed" if gauge is None else gauge.size
        yield "virtual strain gauge (VSG)", size, "window and subset together"
        yield "rigid-body motion", "taken out" if precise["rigid"] else "kept", ""


def _uncertainty(facts: _Facts) -> _Rows:
    floor, last = facts.product("noise"), facts.product("total", last=True)
    noise = () if floor is None else NoiseFloorTable.read(floor).rows
    unit = "mm" if facts.total is None else facts.total.unit
    correlation = facts.product("correlation", last=True)
    if correlation is not None:
        found = Correlation.read(correlation)
        yield "image noise", f"{found.noise_grey:.2f} grey levels", found.noise_source
    summary = {} if last is None else summary_of(last)
    for name in BASIC:
        own, symbol = unit_of(name, unit), QUANTITIES[name].symbol
        rows = [row for row in noise if row["quantity"] == name]
        predicted = summary.get(f"u_{named_with_unit(name, unit)}")
        if rows:
            yield f"noise floor of {symbol}", _floor(rows, own), "measured where nothing deforms"
        elif predicted is not None:
            remark = "by noise and the bias that remains: median of the last step"
            yield f"{UNCERTAINTY} of {symbol}", _with_unit(predicted, own), remark
    if not noise:
        hint = "photograph the unmoved specimen and add a stage noise_floor"
        yield "noise floor and bias of every quantity", None, hint


def _text(value: Any, pattern: str) -> str | None:
    """A value in words, None if unknown."""
    unknown = value is None or (isinstance(value, float) and not math.isfinite(value))
    return None if unknown else pattern.format(value)


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.2g}" + ("" if unit == "1" else f" {unit}")


def _floor(rows: list[Mapping[str, Any]], unit: str) -> str:
    """Largest bias and quadratic mean of σ over the steps."""
    bias = max((row["bias"] or 0.0 for row in rows), key=abs)
    sigma = math.sqrt(sum((row["sigma"] or 0.0) ** 2 for row in rows) / len(rows))
    return f"σ {_with_unit(sigma, unit)}, bias {_with_unit(bias, unit)}"


def _bits(photograph: ArrayFacts | None) -> str | None:
    return None if photograph is None else f"{8 * int(photograph.dtype[2:])} bit"


def _focal(facts: _Facts) -> str | None:
    if facts.cameras is None:
        return None
    left, right = facts.cameras.focal_px
    return f"{left:.1f}, {right:.1f} px"


def _view(size: tuple[int, int] | None, scale: float | None) -> str | None:
    return None if size is None or scale is None else f"{size[0] / scale:.1f} × {size[1] / scale:.1f} mm"


def _steps(result: Result) -> str:
    counts = [len(result.steps(result.source(stage, "images"))) for stage in result.stages_of("region")]
    return str(max(counts, default=0))


def _speckles(size: float | None, scale: float | None) -> str | None:
    text = _text(size, "{:.1f} px")
    return text + f" = {size / scale:.2g} mm" if text and size and scale else text


def _filter(smoothing: float) -> str:
    return f"Gaussian low pass, σ {smoothing:g} px" if smoothing else "none"


def _weight(gaussian: float) -> str:
    return f"Gaussian, σ {gaussian:g} px" if gaussian else "equal"


def _surface(surface: Mapping[str, Any]) -> str:
    if surface["method"] == "lowess":
        return f"local regression over {surface['lowess_window']:g} px, {surface['robust']}"
    degree = surface["degree"]
    degrees = (
        degree if degree == "auto" else ", ".join(f"{axis} {sides[0]}×{sides[1]}" for axis, sides in degree.items())
    )
    return f"polynomials of degree {degrees}; outliers: {surface['robust']}"


def _window(chosen: Mapping[str, Any]) -> str:
    """Window in px and degree of a local fit."""
    window = chosen["window"]
    sides = (window, window) if isinstance(window, int | float) else window
    return f"{sides[0]:g} × {sides[1]:g} px, degree {chosen['degree']}"


def _axes(facts: _Facts) -> str:
    if facts.total is not None and not facts.total.in_space:
        unit = "pixels of the image" if facts.total.unit == "px" else "mm in the plane of the specimen"
        return f"{unit}: x right, y down"
    return "left camera: X right, Y down, Z away"
