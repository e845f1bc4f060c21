"""Windows of image 1: where they lie, and dense matches inside each, guided by a first idea of its plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError
from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.metrics import normal_angle
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.planes.evidence import Evidence
from slopecli.planes.robust import robust_plane
from slopecli.types import Camera, FloatArray, IntArray
from slopecli.vision.dense import Cells, dense_cells
from slopecli.vision.photometric import PlaneFit, View, align_plane, cell_shifts, make_view, sweep_planes
from slopecli.vision.warp import Pyramid, cut, sample_map

Window = tuple[int, int, int, int]  # x, y, width, height in px of image 1

MIN_SIDE_PX = 16
FINE_PX = 200  # a window is matched at about this many pixels a side, from shrunken images when it is larger
COARSE_PX = 48  # and planes are searched at this many
EASY_SHARE = 0.25  # of the window covered by matches of the overview: then they give the first plane
GOOD_SCORE = 0.8  # photometric correlation at which no further plane is searched for
BORDER_PX = 8  # px of the working grid around a window: flow needs to see past its border
SWEEP_LIMIT = 60
INFORMED_DEG = 8.0  # 1-sigma of the normal from the pixels alone above which a window is too bare to answer by itself
PIXEL_CORRELATION = 3.0  # neighbouring pixels share noise and interpolation: standard errors grow by this


def grid_windows(columns: int, rows: int, width: int, height: int) -> list[Window]:
    """The image divided evenly, row by row from the top left."""
    xs = [round(i * width / columns) for i in range(columns + 1)]
    ys = [round(j * height / rows) for j in range(rows + 1)]
    return [(xs[i], ys[j], xs[i + 1] - xs[i], ys[j + 1] - ys[j]) for j in range(rows) for i in range(columns)]


def check_windows(windows: list[Window], width: int, height: int) -> None:
    """Raise InputError for the first window that is too small or not inside image 1."""
    for number, (x, y, w, h) in enumerate(windows, 1):
        if w < MIN_SIDE_PX or h < MIN_SIDE_PX:
            raise InputError(
                f"window {number} is {w}x{h} px, at least {MIN_SIDE_PX}x{MIN_SIDE_PX} are needed; use larger windows"
            )
        if x < 0 or y < 0 or x + w > width or y + h > height:
            raise InputError(
                f"window {number} ({x},{y},{w},{h}) is not inside image 1, which is {width}x{height} px; "
                f"keep 0 <= X, X+W <= {width} and 0 <= Y, Y+H <= {height}"
            )


def window_polygon(window: Window) -> FloatArray:
    """Corners (4, 2) px of the window's outline, pixel edges at half integers."""
    x, y, w, h = window
    left, top, right, bottom = x - 0.5, y - 0.5, x + w - 0.5, y + h - 0.5
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


@dataclass(frozen=True, eq=False)
class Scene:
    """What is known before the windows are looked at: images, cameras, the motion, evidence and the scene's planes."""

    camera1: Camera
    camera2: Camera
    pyramid1: Pyramid
    pyramid2: Pyramid
    R: FloatArray
    T: FloatArray
    evidence: Evidence
    planes: list[FloatArray]

    @property
    def shape2(self) -> tuple[int, int]:
        return self.camera2.height, self.camera2.width


@dataclass(frozen=True, eq=False)
class WindowMatch:
    """Matches that speak for a window's plane.

    uv1, uv2 (n, 2) px; variance_px (n, 2): relative noise variance along and across the epipolar line, px^2;
    index (n, 2): row and column of the cells; origin "own" when they lie in the window, "borrowed" when they are of
    the plane around it, because nothing inside can be matched; doubt_rad: then, how far the planes around disagree.
    """

    uv1: FloatArray
    uv2: FloatArray
    x1: FloatArray
    x2: FloatArray
    index: IntArray
    variance_px: FloatArray
    origin: Literal["own", "borrowed", "none"]
    score: float
    share: float
    reason: str = ""
    doubt_rad: float = 0.0


def match_window(window: Window, scene: Scene) -> WindowMatch:
    """Dense matches of one window, or those of the plane around it, or none with the reason."""
    first = _plane_from_overview(window, scene)
    if first is not None:
        match = _dense_match(window, scene, first)
        if match.origin == "own":
            return match
    for fit in _search_plane(window, scene):
        match = _dense_match(window, scene, fit)
        if match.origin == "own":
            return match
    return _borrow(window, scene)


def _plane_from_overview(window: Window, scene: Scene) -> FloatArray | None:
    inside = scene.evidence.near(window, 0.0)
    cell_area = 64.0 / float(np.prod(scene.pyramid1.overview_scale))
    if inside.sum() * cell_area < EASY_SHARE * window[2] * window[3]:
        return None
    return scene.evidence.plane_through(inside)


def _view(window: Window, scene: Scene, side_px: int, border: bool) -> View:
    x, y, w, h = window
    shrink_by = max(w, h) / side_px
    layer = scene.pyramid1.at(shrink_by)
    margin = BORDER_PX / float(layer.scale.min()) if border else 0.0
    grid = cut(layer, x - margin, y - margin, w + 2 * margin, h + 2 * margin)
    return make_view(
        grid,
        lambda uv: rays_from_pixels(scene.camera1, uv),
        lambda rays: pixels_from_rays(scene.camera2, rays),
        scene.R,
        scene.T,
        scene.pyramid2,
        scene.shape2,
    )


def _search_plane(window: Window, scene: Scene) -> list[FloatArray]:
    """Planes worth a dense match, best first: those of the neighbourhood and the scene, else a sweep over depth."""
    view = _view(window, scene, COARSE_PX, border=False)
    if min(view.grid.shape) < 8:
        return []
    candidates = [scene.evidence.plane_through(scene.evidence.near(window, grow)) for grow in (0.0, 0.5, 1.5)]
    fits = [align_plane(view, normal, 6) for normal in (*candidates, *scene.planes) if normal is not None]
    fits = [fit for fit in fits if np.isfinite(fit.score)]
    if max((fit.score for fit in fits), default=-1.0) < GOOD_SCORE and len(scene.evidence) >= 10:
        depths = _sweep_depths(scene.evidence, float(view.grid.scale.mean()))
        fits += [align_plane(view, fit.normal, 8) for fit in sweep_planes(view, depths)]
    fits.sort(key=lambda fit: -fit.score)
    best = [fit for fit in fits[:1] if fit.score > 0.3]
    return [fit.normal for fit in (_sharpen(window, scene, fit) for fit in best) if _informed(fit)]


def _sweep_depths(evidence: Evidence, scale: float) -> FloatArray:
    low, high = np.percentile(evidence.w, [1, 99])
    spread = high - low
    low, high = max(low - 0.3 * spread, 1e-4 * high), high + 0.3 * spread
    pixels = (high - low) * float(np.median(evidence.leverage)) * evidence.focal_px * scale
    return np.linspace(low, high, int(np.clip(pixels, 8, SWEEP_LIMIT)))


def _sharpen(window: Window, scene: Scene, fit: PlaneFit) -> PlaneFit:
    for side in (COARSE_PX * 2, FINE_PX):
        if max(window[2:]) > 0.6 * side:
            fit = align_plane(_view(window, scene, side, border=False), fit.normal, 8)
    return fit


def _informed(fit: PlaneFit) -> bool:
    if not np.isfinite(fit.covariance).all():
        return False
    length = float(np.linalg.norm(fit.normal))
    unit = fit.normal / max(length, 1e-12)
    project = (np.eye(3) - np.outer(unit, unit)) / max(length, 1e-12)
    sigma = np.sqrt(max(np.linalg.eigvalsh(project @ fit.covariance @ project.T)[-1], 0.0))
    return bool(np.degrees(sigma) * PIXEL_CORRELATION < INFORMED_DEG)


def _dense_match(window: Window, scene: Scene, normal: FloatArray) -> WindowMatch:
    view = _view(window, scene, FINE_PX, border=True)
    if min(view.grid.shape) < MIN_SIDE_PX:
        return _nothing("too few pixels")
    side = max(window[2:]) * float(view.grid.scale.mean())
    cell = int(np.clip(side / 16, 4, 8))
    cells = dense_cells(view.grid, view.mapping(normal), scene.pyramid2, scene.shape2, cell, finest=0)
    x, y, w, h = window
    u, v = cells.uv1.T
    cells = cells.take((u >= x - 0.5) & (u < x + w - 0.5) & (v >= y - 0.5) & (v < y + h - 0.5))
    possible = max(1.0, w * h * float(np.prod(view.grid.scale)) / cell**2)
    return _polish(_usable(cells, scene, possible), window, scene, cell)


def _usable(cells: Cells, scene: Scene, possible: float) -> WindowMatch:
    x1, x2 = rays_from_pixels(scene.camera1, cells.uv1), rays_from_pixels(scene.camera2, cells.uv2)
    focal = scene.camera2.focal_px
    variance = _variance_px(cells, scene)
    residual = np.abs(epipolar_residual(scene.R, scene.T, x1, x2)) * focal * cells.pixel_scale
    good = np.isfinite(x2).all(1) & np.isfinite(x1).all(1) & (residual < 1.0)
    good &= (variance[:, 0] * cells.pixel_scale**2 < MAX_SIGMA_PX**2) & (cells.agreement > 0.3)
    share = float(good.sum() / possible)
    if good.sum() < 8 or share < 0.04:
        return _nothing("too few matches")
    w, leverage = inverse_depth(scene.R, scene.T, x1[good], x2[good])
    plane = robust_plane(x1[good], w, leverage, 0.03 / focal / cells.pixel_scale)
    doubt = SCARCE_RAD * max(0.0, 1 - share / SCARCE_SHARE)
    doubt += plane.doubt_rad(homogeneous(x1[good]) * leverage[:, None], w * leverage)
    keep = np.flatnonzero(good)[plane.inlier]
    score = float(np.median(cells.agreement[good]))
    across = epipolar_residual(scene.R, scene.T, x1[keep], x2[keep]) * focal
    variance = variance[keep] * _overdispersion(across**2 / variance[keep, 1])
    return WindowMatch(
        cells.uv1[keep], cells.uv2[keep], x1[keep], x2[keep], cells.index[keep], variance, "own", score, share,
        doubt_rad=doubt,
    )  # fmt: skip


def _overdispersion(normalised_squares: FloatArray) -> float:
    """By how much a window's own residuals exceed the variance predicted from its texture: a robust ratio.

    Many cells may show that they are better than predicted; few cells agree by chance, so they are not believed.
    """
    least = np.interp(len(normalised_squares), [20, 60], [1.0, 0.25])
    return max(float(np.median(normalised_squares)) / CHI2_MEDIAN, float(least))


SCARCE_SHARE, SCARCE_RAD = 0.15, np.radians(10.0)  # matched over less than this, the rest of a window may tilt otherwise
CHI2_MEDIAN = 0.4549  # of chi-square with one degree of freedom


CLEAR_SCORE, CLEAR_SHARE = 0.9, 0.6  # where flow sees this much this well, alignment adds nothing
PLANAR_RATIO = 4.0  # misfit to the plane over the predicted variance of the matches: beyond it there is relief
SHIFT_VARIANCE = 4.0  # cells share noise with their neighbours through interpolation and normalisation


def _polish(match: WindowMatch, window: Window, scene: Scene, cell: int) -> WindowMatch:
    """On a flat window, replace the flow's matches by steps of the pixels about the plane aligned on all of them.

    Flow looks no further than its patches and smooths over what it cannot see; the plane has three parameters, so
    alignment also uses texture too faint for any patch.
    """
    if match.origin != "own" or (match.score > CLEAR_SCORE and match.share > CLEAR_SHARE):
        return match
    view = _view(window, scene, FINE_PX, border=False)
    scale = float(view.grid.scale.mean())
    w, leverage = inverse_depth(scene.R, scene.T, match.x1, match.x2)
    root = leverage / np.sqrt(match.variance_px[:, 0])
    rays = homogeneous(match.x1)
    normal = np.linalg.lstsq(rays * root[:, None], w * root, rcond=None)[0]
    off = (w - rays @ normal) * leverage * scene.camera2.focal_px * scale
    if np.median(off**2 / (match.variance_px[:, 0] * scale**2)) > PLANAR_RATIO * CHI2_MEDIAN:
        return match
    fit = _align_best(view, normal, scene, match.score)
    if fit.score < max(0.5, match.score - 0.2):
        return match
    shifts = cell_shifts(view, fit.normal, cell)
    mapping = view.mapping(fit.normal)
    uv1 = view.grid.full(shifts.centre)
    uv2 = sample_map(mapping, shifts.centre + shifts.shift)
    along, across = _epipolar_axes(uv1, scene)
    information = [np.einsum("ni,nij,nj->n", d, shifts.information, d) for d in (along, across)]
    variance = (POLISH_FLOOR_PX**2 + SHIFT_VARIANCE / np.maximum(np.column_stack(information), 1e-6)) / scale**2
    x1, x2 = rays_from_pixels(scene.camera1, uv1), rays_from_pixels(scene.camera2, uv2)
    good = np.isfinite(x1).all(1) & np.isfinite(x2).all(1) & (np.abs(shifts.shift).max(1) < 1.0)
    good &= variance[:, 0] * scale**2 < FAINTEST_PX**2
    if good.sum() < max(8, 0.3 * len(match.uv1)):
        return match
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    off = (w - homogeneous(x1) @ fit.normal) * leverage * scene.camera2.focal_px
    variance *= _overdispersion(off[good] ** 2 / variance[good, 0])
    return WindowMatch(
        uv1[good], uv2[good], x1[good], x2[good], shifts.index[good], variance[good], "own", fit.score, match.share,
        doubt_rad=match.doubt_rad,
    )  # fmt: skip


def _align_best(view: View, normal: FloatArray, scene: Scene, score: float) -> PlaneFit:
    """Align from the flow's plane; where the window is small and faint, from the scene's planes as well."""
    fit = align_plane(view, normal, 5)
    if score > FAINT_SCORE or view.grid.grey.size > FAINT_PIXELS:
        return fit
    rivals = [align_plane(view, plane, 8) for plane in scene.planes]
    return max([fit, *rivals], key=lambda f: f.score)


FAINT_SCORE, FAINT_PIXELS = 0.85, 100 * 100
POLISH_FLOOR_PX = 0.02
FAINTEST_PX = 1.0  # cells known worse than this add nothing
GREY_NOISE = 2.0  # grey levels; sensor noise of 8-bit images
FLOOR_PX = 0.03  # px of the grid: what interpolation and the flow's own quantisation leave
MAX_SIGMA_PX = 0.5


def _variance_px(cells: Cells, scene: Scene) -> FloatArray:
    """(n, 2) noise variance along and across the epipolar line in full px^2, from each cell's structure tensor."""
    information = [np.einsum("ni,nij,nj->n", d, cells.information, d) for d in _epipolar_axes(cells.uv1, scene)]
    grid = FLOOR_PX**2 + GREY_NOISE**2 / np.maximum(np.column_stack(information), 1e-6)
    return grid / cells.pixel_scale**2


def _epipolar_axes(uv1: FloatArray, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (n, 2) along and across the epipolar line in image 1: a change of depth moves content along it."""
    rays = homogeneous(rays_from_pixels(scene.camera1, uv1))
    along = rays[:, :2] * scene.T[2] - scene.T[:2]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return along, np.column_stack([-along[:, 1], along[:, 0]])


def _borrow(window: Window, scene: Scene) -> WindowMatch:
    """Matches around the window that lie on the plane it most likely belongs to: near it and of its brightness."""
    evidence = scene.evidence
    x, y, w, h = window
    grey = scene.pyramid1.at(1.0).grey[y : y + h, x : x + w]
    centre, side = np.array([x + w / 2, y + h / 2]), max(w, h)
    brightness = float(np.median(grey))
    for grow in (0.75, 1.5, 3.0):
        near = evidence.near(window, grow)
        if near.sum() < 20:
            continue
        offset = np.linalg.norm(evidence.uv1 - centre, axis=1) / (side * (0.5 + grow))
        vote = near * np.exp(-(offset**2)) * np.exp(-(((evidence.grey - brightness) / 30.0) ** 2))
        planes = [p for p in (evidence.plane_through(near), *scene.planes) if p is not None]
        support = [float((vote * (evidence.misfit_px(p) < 1.0)).sum()) for p in planes]
        best = int(np.argmax(support))
        chosen = near & (evidence.misfit_px(planes[best]) < 1.0)
        if chosen.sum() < 12 or support[best] < 2.0:
            continue
        index = np.round((evidence.uv1[chosen] - centre) / max(side / 16, 1.0)).astype(np.int64)
        variance = np.full((int(chosen.sum()), 2), 0.3**2)
        return WindowMatch(
            evidence.uv1[chosen],
            scene_pixels(scene.camera2, evidence.x2[chosen]),
            evidence.x1[chosen],
            evidence.x2[chosen],
            index[:, ::-1],
            variance,
            "borrowed",
            0.0,
            0.0,
            doubt_rad=max(_disagreement(planes, support, best), LONELY_RAD * (1 - support[best] / float(vote.sum()))),
        )
    return _nothing("nothing in or around the window can be matched")


LONELY_RAD = np.radians(60.0)  # doubt about a borrowed plane that nothing around the window supports


def _disagreement(planes: list[FloatArray], support: list[float], best: int) -> float:
    """RMS angle between the chosen plane and the others, each weighted by the support it has."""
    share = np.array(support) / max(sum(support), 1e-9)
    angles = np.array([float(normal_angle(plane, planes[best])) for plane in planes])
    return float(np.sqrt(share @ np.minimum(angles, np.pi - angles) ** 2))


def scene_pixels(camera: Camera, x: FloatArray) -> FloatArray:
    """Normalised coordinates as pixels of the stored image."""
    return pixels_from_rays(camera, x)


def _nothing(reason: str) -> WindowMatch:
    empty = np.empty((0, 2))
    return WindowMatch(empty, empty, empty, empty, np.empty((0, 2), np.int64), empty, "none", 0.0, 0.0, reason)


def paint_labels(windows: list[Window], ids: list[int], shape: tuple[int, int]) -> NDArray[np.uint16]:
    """(h, w) uint16 with each window's id inside it; where windows overlap the later one wins."""
    labels = np.zeros(shape, np.uint16)
    for (x, y, w, h), number in zip(windows, ids, strict=True):
        labels[y : y + h, x : x + w] = number
    return labels

