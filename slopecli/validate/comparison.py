"""Compare every patch, and every cell of a map, with the plane of the known ground under it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError
from slopecli.geometry.epipolar import direction_angle, normal_angle
from slopecli.geometry.statistics import MAD_FACTOR, median
from slopecli.ground.footprint_planes import fit_footprints
from slopecli.ground.footprints import Cells
from slopecli.ground.sites import plane_of
from slopecli.look.matches import MIN_ON_PLANE
from slopecli.options import Options
from slopecli.types import FloatArray
from slopecli.validate.finished_result import Result, ResultMap, ResultPlane
from slopecli.validate.truth import Truth
from slopecli.windows import inside_window


class ComparisonTunables(NamedTuple):
    """Tunables of the comparison."""

    gate: float = 4.0  # robust sigmas off its plane from which on points under a plane of any shape belong to others


COMPARE = ComparisonTunables()


@dataclass(frozen=True, eq=False)
class PatchCompared:
    """A patch against the ground under it; angles in degrees, lengths of the truth in its own unit.

    difference_deg : slope less the true slope.  normal_error_deg : angle between the normals, of the better answer
        where two are left.  distance_ratio : true distance of the plane over that of the answer, with the scale solved.
    true_rms : of the points off their plane.
    """

    id: int
    slope_deg: float
    true_slope_deg: float
    difference_deg: float
    sigma_deg: float | None
    normal_error_deg: float
    distance_ratio: float
    n_points: int
    true_rms: float
    true_normal: FloatArray
    true_middle: FloatArray
    verdict: str | None
    status: str

    @property
    def sigmas(self) -> float | None:
        """The difference of the slopes in sigmas; None without a sigma."""
        return self.difference_deg / self.sigma_deg if self.sigma_deg else None


@dataclass(frozen=True, eq=False)
class CellsCompared:
    """The cells of a map against the truth: how many, |difference| of the slopes (deg), share within 2 sigma, and how
    many that are steeper than the tolerance are called safe."""

    n: int
    median_deg: float
    p90_deg: float
    within_two_sigma: float
    steep: int
    steep_called_safe: int


@dataclass(frozen=True, eq=False)
class Comparison:
    """All patches that have truth under them, by id.

    missing : ids of those that have none.  scale : unit of the truth per unit of the answer, and its relative spread.
    cells : of a map whose truth is a depth.
    """

    patches: tuple[PatchCompared, ...]
    missing: tuple[int, ...]
    scale: float
    scale_spread: float
    cells: CellsCompared | None = None


def compare(result: Result, truth: Truth, surfaces: NDArray[Any] | None = None) -> Comparison:
    """Fit a plane to the truth under every patch, and one scale to all.

    surfaces : (h, w) number of the true surface that every pixel of image 1 shows, 0 for none. A patch is compared with
        the plane of the whole surface that most of it is on.
    InputError : no patch has truth under it.
    """
    under = _points_under(result, truth, surfaces)
    known = [plane for plane in result.planes if len(under[plane.id].points) >= 2 * MIN_ON_PLANE]
    if not known:
        raise InputError(
            f"none of the {len(result.planes)} planes has {2 * MIN_ON_PLANE} points of the truth under it; needed the "
            "truth of what image 1 shows"
        )
    others = surfaces is None  # where nothing says which points belong to the surface
    fits = [fit_plane(under[plane.id], robust=others and (plane.found or truth.in_disparity)) for plane in known]
    ratios = np.array([abs(fit.normal @ fit.middle) / plane.distance for fit, plane in zip(fits, known, strict=True)])
    scale, spread = _scale(ratios, known)
    patches = [
        _compared(plane, fit, ratio / scale, result.up)
        for plane, fit, ratio in zip(known, fits, ratios.tolist(), strict=True)
    ]
    missing = tuple(plane.id for plane in result.planes if plane not in known)
    cells = None if result.cells is None else _cells(result, result.cells, truth)
    return Comparison(tuple(patches), missing, scale, spread, cells)


def _points_under(result: Result, truth: Truth, surfaces: NDArray[Any] | None) -> dict[int, Truth]:
    """The points that every patch is compared with, by its id."""
    if surfaces is None:
        return {plane.id: truth.some(_under(plane, result, truth)) for plane in result.planes}
    at = _numbers_at(truth, surfaces)
    return {plane.id: truth.some(_surface_under(plane, result, truth, at)) for plane in result.planes}


def _under(plane: ResultPlane, result: Result, truth: Truth) -> np.ndarray:
    """(n,) which points of the truth a patch covers."""
    low, high = plane.polygon_px.min(axis=0), plane.polygon_px.max(axis=0)
    if not plane.found:
        x, y = (low + 0.5).tolist()
        w, h = (high - low).tolist()
        return inside_window(truth.uv, (round(x), round(y), round(w), round(h)))
    if result.labels is None:
        raise InputError("the answer has no labels.png, which says what its planes cover; keep the file beside it")
    columns, rows = np.floor(truth.uv + 0.5).astype(int).T
    return np.asarray(result.labels[rows, columns] == plane.id)


def _numbers_at(truth: Truth, surfaces: NDArray[Any]) -> NDArray[Any]:
    """(n,) number of the surface of every point."""
    columns, rows = np.floor(truth.uv + 0.5).astype(int).T
    return surfaces[rows, columns]


def _surface_under(plane: ResultPlane, result: Result, truth: Truth, at: NDArray[Any]) -> np.ndarray:
    """(n,) which points lie on the surface that most of a patch is on; none if it is on no surface."""
    numbers, counts = np.unique(at[_under(plane, result, truth)], return_counts=True)
    if not len(numbers) or counts.max() < 0.5 * counts.sum() or numbers[counts.argmax()] == 0:
        return np.zeros(len(at), bool)
    return np.asarray(at == numbers[counts.argmax()])


def _scale(ratios: FloatArray, planes: Sequence[ResultPlane]) -> tuple[float, float]:
    """The scale of most sure planes, or of most planes where none is sure, and its relative spread."""
    sure = np.array([plane.sigma_deg is None or plane.sigma_deg <= Options().max_sigma_deg for plane in planes])
    chosen = ratios[sure] if sure.any() else ratios
    scale = median(chosen)
    return scale, MAD_FACTOR * median(np.abs(chosen / scale - 1.0))


@dataclass(frozen=True, eq=False)
class TruePlane:
    """Plane of known ground: unit normal towards camera 1, middle on it, RMS of the points off it, their number."""

    normal: FloatArray
    middle: FloatArray
    rms: float
    n: int


def fit_plane(truth: Truth, robust: bool) -> TruePlane:
    """The plane nearest to points, by perpendicular distance, or by inverse depth where that is what was measured.

    robust : leave out points that are far off the plane of the others, as along the border of a plane of any shape, or
        where a disparity is a mismatch.
    """
    kept = np.ones(len(truth.points), bool)
    for _ in range(5 if robust else 1):
        plane = _fit(truth.some(kept))
        off = np.abs((truth.points - plane.middle) @ plane.normal)
        inside = off <= max(COMPARE.gate * MAD_FACTOR * median(off[kept]), 1e-9 * float(truth.points[:, 2].mean()))
        if (inside == kept).all() or inside.sum() < 2 * MIN_ON_PLANE or not robust:
            break
        kept = inside
    return _fit(truth.some(kept))


def _fit(truth: Truth) -> TruePlane:
    points = truth.points
    middle = points.mean(axis=0)
    if truth.in_disparity:
        rays = points / points[:, 2:]
        N = np.linalg.lstsq(rays, 1.0 / points[:, 2], rcond=None)[0]
        normal = -N / np.linalg.norm(N)
        middle = rays.mean(axis=0) / (rays.mean(axis=0) @ N)
    else:
        normal, _ = plane_of(points)
    rms = float(np.sqrt((((points - middle) @ normal) ** 2).mean()))
    return TruePlane(normal, middle, rms, len(points))


def _compared(plane: ResultPlane, fit: TruePlane, ratio: float, up: FloatArray) -> PatchCompared:
    true_slope = float(np.degrees(direction_angle(fit.normal, up)))
    return PatchCompared(
        id=plane.id,
        slope_deg=plane.slope_deg,
        true_slope_deg=true_slope,
        difference_deg=plane.slope_deg - true_slope,
        sigma_deg=plane.sigma_deg,
        normal_error_deg=float(np.degrees(normal_angle(np.stack(plane.normals), fit.normal).min())),
        distance_ratio=ratio,
        n_points=fit.n,
        true_rms=fit.rms,
        true_normal=fit.normal,
        true_middle=fit.middle,
        verdict=plane.verdict,
        status=plane.status,
    )


def _cells(result: Result, cells: ResultMap, truth: Truth) -> CellsCompared:
    """Compare the cells of a map with the planes of the true ground in their footprints, where it is known all over."""
    height, width = result.cameras[0].height, result.cameras[0].width
    points = np.zeros((height, width, 3), np.float32)
    known = np.zeros((height, width), bool)
    columns, rows = np.floor(truth.uv + 0.5).astype(int).T
    points[rows, columns], known[rows, columns] = truth.points, True
    v, u = (((np.arange(n) + 0.5) * cells.spacing_px - 0.5).astype(np.int64) for n in cells.slope_deg.shape)
    planes = fit_footprints(points, known, known, Cells(u, v, cells.footprint_px / 2.0))
    cosine = np.clip((planes.normal * result.up).sum(-1), -1.0, 1.0)
    true_deg = np.degrees(np.arccos(cosine))
    both = np.isfinite(cells.slope_deg) & (planes.share >= 0.99)
    if not both.any():
        return CellsCompared(0, float("nan"), float("nan"), float("nan"), 0, 0)
    off = np.abs(cells.slope_deg - true_deg)[both]
    steep = both & (true_deg > result.tolerance_deg)
    return CellsCompared(
        n=int(both.sum()),
        median_deg=median(off),
        p90_deg=float(np.quantile(off, 0.9)),
        within_two_sigma=float((off <= 2.0 * cells.sigma_deg[both]).mean()),
        steep=int(steep.sum()),
        steep_called_safe=int((steep & (cells.p_safe >= result.confidence)).sum()),
    )


def summary_lines(comparison: Comparison, unit: str) -> Sequence[str]:
    """What the comparison says in all, a line each."""
    patches = comparison.patches
    off = np.abs([one.difference_deg for one in patches])
    normal = np.array([one.normal_error_deg for one in patches])
    sigmas = np.abs([one.sigmas for one in patches if one.sigmas is not None])
    within = f"; {100 * float((sigmas <= 2).mean()):.0f} % within 2 sigma" if len(sigmas) else ""
    lines = [
        f"{len(patches)} planes: slopes off by {median(off):.2f}° in median, {off.max():.2f}° at most{within}; normals "
        f"by {median(normal):.2f}° in median, {normal.max():.2f}° at most",
        f"scale: 1 {unit} of the answer is {comparison.scale:.5g} of the truth, planes agree to "
        f"{100 * comparison.scale_spread:.2g} %",
    ]
    if comparison.missing:
        lines.append(f"no truth under {', '.join(map(str, comparison.missing))}")
    cells = comparison.cells
    if cells is not None and not cells.n:
        lines.append("cells of the map are compared with a --depth or --disparity of the size of image 1 alone")
    elif cells is not None:
        lines.append(
            f"{cells.n} cells of the map: slopes off by {cells.median_deg:.2f}° in median, {cells.p90_deg:.2f}° at "
            f"90 %; {100 * cells.within_two_sigma:.0f} % within 2 sigma; {cells.steep_called_safe} of {cells.steep} "
            "steep ones called safe"
        )
    return lines
