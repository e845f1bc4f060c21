"""From a solution in rays and baselines to what a user reads: slopes, verdicts, statuses, scale."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from slopecli.diagnosis import diagnose, epipole1_px
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.homography import homography_in_pixels, homography_of_plane
from slopecli.geometry.metrics import rotation_angle
from slopecli.geometry.slope import measure_slopes, probability_below, slope_interval, surface_normals
from slopecli.options import Options
from slopecli.planes.joint import Matched
from slopecli.planes.window_match import WindowMatch
from slopecli.planes.windows import paint_labels, window_polygon
from slopecli.types import (
    Alternative,
    AlternativePlane,
    AmbiguityReport,
    BoolArray,
    Camera,
    Correspondences,
    Diagnostic,
    Fit,
    FloatArray,
    Image,
    ImageInfo,
    Motion,
    Plane,
    Rejected,
    Report,
    Scale,
    Slopes,
    Solution,
    Up,
)

Verdict = Literal["safe", "unsafe", "undecided"]

CAMERA_UP = (0.0, 0.0, -1.0)  # the camera looks straight down
UNKNOWN_DEG = 60.0  # a slope whose 1-sigma is larger than this is no answer
ROUGH = 0.03  # RMS height off the plane over distance beyond which a window is not one plane
MIN_INLIER_SHARE = 0.5  # of a window's matches on its plane: with fewer it is not one plane, either
BORROWED_SIGMA_DEG = 5.0  # terrain next to a window tells its slope no better than this


@dataclass(frozen=True, eq=False)
class _Measured:
    """A solution with all that its planes are written from; row k of every array is answered patch k.

    roots : slopes of every root that geometry leaves, the solution's own first.  normals : (m, 3) unit, towards
    camera 1.  ci95_rad : (m, 2).  p_safe : (r, m) P(slope < tolerance) in every root.  length : a baseline, in the
    unit of `scale`.
    """

    matched: Matched
    solution: Solution
    cameras: tuple[Camera, Camera]
    options: Options
    up: Up
    roots: list[Slopes]
    normals: FloatArray
    ci95_rad: FloatArray
    p_safe: FloatArray
    scale: Scale
    length: float


def build_report(
    images: tuple[Image, Image],
    cameras: tuple[Camera, Camera],
    options: Options,
    matched: Matched,
    solution: Solution,
    diagnostics: list[Diagnostic],
) -> Report:
    """Assemble everything that is written and shown."""
    measured = _measure(cameras, options, matched, solution)
    every = tuple(_plane(k, measured) for k in range(len(matched.answered)))
    planes = tuple(plane for plane in every if _known(plane))
    ids = [plane.id for plane in planes]
    relief = {plane.id: float(r) for plane, r in zip(every, solution.relief, strict=True)}
    epipole = epipole1_px(solution, cameras[0])
    shape = (images[0].height, images[0].width)
    return Report(
        images=(_info(images[0]), _info(images[1])),
        cameras=cameras,
        options=_options_dict(options),
        up=measured.up,
        scale=measured.scale,
        motion=_motion(solution, measured.length),
        fit=_fit(solution, matched, cameras[1]),
        ambiguity=_ambiguity(measured),
        planes=planes,
        rejected=_rejected(matched, every),
        diagnostics=(*diagnostics, *diagnose(planes, relief, solution, epipole)),
        labels=paint_labels([matched.windows[i - 1] for i in ids], ids, shape),
        epipole1_px=epipole,
    )


def _info(image: Image) -> ImageInfo:
    return ImageInfo(image.path, image.width, image.height, image.sha256)


def _options_dict(options: Options) -> dict[str, object]:
    values = asdict(options)
    # the grid speaks only where no windows are given
    values["grid" if options.windows else "windows"] = None
    return values


def _measure(cameras: tuple[Camera, Camera], options: Options, matched: Matched, solution: Solution) -> _Measured:
    up = _up(solution, matched, options)
    scale, length = _scale(solution, matched, up, options)
    other = solution.ambiguity.alternative if solution.ambiguity.status == "unresolved" else None
    roots = [_slopes(root, matched, options, up) for root in (solution, other) if root is not None]
    return _Measured(
        matched=matched,
        solution=solution,
        cameras=cameras,
        options=options,
        up=up,
        roots=roots,
        normals=surface_normals(solution),
        ci95_rad=slope_interval(roots[0]),
        p_safe=np.array([probability_below(slopes, float(np.radians(options.tolerance_deg))) for slopes in roots]),
        scale=scale,
        length=length,
    )


def dominant_plane(matched: Matched) -> int:
    """Index of the answered patch with the largest footprint."""
    areas = [matched.windows[i][2] * matched.windows[i][3] for i in matched.answered]
    return int(np.argmax(areas))


def _up(solution: Solution, matched: Matched, options: Options) -> Up:
    if options.up == "dominant-plane":
        level = surface_normals(solution)[dominant_plane(matched)]
        return Up(_triple(level), "dominant-plane", options.up_sigma_deg)
    given = not isinstance(options.up, str)
    up = np.array(options.up if given else CAMERA_UP, float)
    return Up(_triple(up / np.linalg.norm(up)), "given" if given else "camera", options.up_sigma_deg)


def _triple(v: FloatArray) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def _slopes(root: Solution, matched: Matched, options: Options, up: Up) -> Slopes:
    """Slopes of one root; a dominant plane that is taken as level is level in every root."""
    north = None if options.north is None else np.array(options.north, float)
    sigma = float(np.radians(options.up_sigma_deg))
    if up.source == "dominant-plane":
        slopes = measure_slopes(root, None, sigma, north, up_plane=dominant_plane(matched))
    else:
        slopes = measure_slopes(root, np.array(up.vector_cam1), sigma, north)
    return _doubted(slopes, matched)


def _doubted(slopes: Slopes, matched: Matched) -> Slopes:
    """Add to the tilt what no residual shows: ground beside a window tilts otherwise, part of it was left out."""
    chosen = [matched.matches[i] for i in matched.answered]
    least = np.radians(BORROWED_SIGMA_DEG)
    extra = np.array([np.hypot(least if m.origin == "borrowed" else 0.0, m.doubt_rad) for m in chosen])
    if not extra.any():
        return slopes
    variance = extra**2
    covariance = slopes.tilt_covariance + variance[:, None, None] * np.eye(2)
    sigma = np.sqrt(slopes.sigma_rad**2 + variance)
    known = slopes.slope_rad >= 2 * sigma
    nothing = np.where(known, 0.0, np.nan)
    return Slopes(slopes.slope_rad, sigma, slopes.aspect_rad + nothing, slopes.aspect_sigma_rad + nothing, covariance)


def _scale(solution: Solution, matched: Matched, up: Up, options: Options) -> tuple[Scale, float]:
    """The unit of lengths, and how many of it a baseline is."""
    if options.baseline_m is not None:
        return Scale("m", "baseline"), options.baseline_m
    if options.altitude_m is None:
        return Scale(), 1.0
    heights = []
    for k in range(len(matched.answered)):
        rays = homogeneous(matched.correspondences.x1[matched.correspondences.patch == k])
        depth = 1.0 / (rays @ solution.scaled_normals[k])
        heights.append(float(np.median(-(rays * depth[:, None]) @ np.array(up.vector_cam1))))
    return Scale("m", "altitude"), options.altitude_m / abs(float(np.median(heights)))


def _motion(solution: Solution, length: float) -> Motion:
    rotation_sigma = np.sqrt(np.linalg.eigvalsh(solution.motion_covariance[:3, :3])[-1])
    direction_sigma = np.sqrt(np.linalg.eigvalsh(solution.direction_covariance)[-1])
    return Motion(
        solution.R,
        solution.T * length,
        float(np.degrees(rotation_angle(solution.R))),
        float(np.degrees(rotation_sigma)),
        float(np.degrees(direction_sigma)),
    )


def _fit(solution: Solution, matched: Matched, camera2: Camera) -> Fit:
    focal = camera2.focal_px
    return Fit(
        solver=solution.solver,
        refine="points",
        rms_px=solution.rms * focal,
        noise_px=_typical_noise(solution, matched) * focal,
        iterations=solution.iterations,
        converged=solution.converged,
        n_correspondences=len(solution.inlier),
        n_inliers=int(solution.inlier.sum()),
    )


def _typical_noise(solution: Solution, matched: Matched) -> float:
    """The solver's noise is that of a match of weight one; this is that of the median match."""
    return solution.noise / float(np.sqrt(np.median(matched.weights)))


def _plane(k: int, measured: _Measured) -> Plane:
    matched, solution, slopes = measured.matched, measured.solution, measured.roots[0]
    window, match = matched.windows[matched.answered[k]], matched.matches[matched.answered[k]]
    member = matched.correspondences.patch == k
    kept = member & solution.inlier
    distance = _signed_distance(solution.scaled_normals[k], matched.correspondences.x1[member], measured.length)
    low, high = np.degrees(measured.ci95_rad[k])
    aspect = None if np.isnan(slopes.aspect_rad[k]) else float(np.degrees(slopes.aspect_rad[k]))
    roughness = float(solution.relief[k])
    status, reason = _status(match, roughness, float(kept.sum() / max(member.sum(), 1)))
    homography = homography_of_plane(solution.R, solution.T, solution.scaled_normals[k])
    return Plane(
        id=matched.answered[k] + 1,
        source="window",
        polygon_px=window_polygon(window),
        normal_cam1=measured.normals[k],
        distance=distance,
        slope_deg=float(np.degrees(slopes.slope_rad[k])),
        slope_sigma_deg=float(np.degrees(slopes.sigma_rad[k])),
        slope_ci95_deg=(float(low), float(high)),
        aspect_deg=aspect,
        dip_direction_deg=aspect,
        n_correspondences=int(member.sum()),
        n_inliers=int(kept.sum()),
        rms_px=_rms(homography, matched.correspondences, kept) * measured.cameras[1].focal_px,
        roughness=roughness * distance if measured.scale.unit == "m" else roughness,
        homography_px=homography_in_pixels(homography, measured.cameras[0].K, measured.cameras[1].K),
        verdict=_verdict(measured.p_safe[:, k], status, measured.options.confidence),
        p_safe=float(measured.p_safe[0, k]),
        status=status,
        reason=reason,
    )


def _signed_distance(normal: FloatArray, x1: FloatArray, length: float) -> float:
    """Perpendicular distance from camera 1, negative for a plane that mismatches have put behind it."""
    ahead = float(np.median(homogeneous(x1) @ normal)) > 0
    return (1 if ahead else -1) * length / float(np.linalg.norm(normal))


def _status(match: WindowMatch, roughness: float, inlier_share: float) -> tuple[Literal["ok", "poor"], str | None]:
    if match.origin == "borrowed":
        return "poor", match.reason
    if roughness > ROUGH or inlier_share < MIN_INLIER_SHARE:
        return "poor", "non-planar-patch"
    return "ok", None


def _verdict(p_safe: FloatArray, status: str, confidence: float) -> Verdict:
    """Of P(slope < tolerance) in every root: safe only where the window itself was seen to be a plane."""
    if status == "ok" and p_safe.min() >= confidence:
        return "safe"
    return "unsafe" if p_safe.max() <= 1 - confidence else "undecided"


def _rms(H: FloatArray, points: Correspondences, kept: BoolArray) -> float:
    """RMS residual per coordinate in image 2, normalised; NaN where no point was kept."""
    if not kept.any():
        return float("nan")
    y = homogeneous(points.x1[kept]) @ H.T
    residual = y[:, :2] / y[:, 2:] - points.x2[kept]
    return float(np.sqrt((residual**2).sum(1).mean() / 2))


def _ambiguity(measured: _Measured) -> AmbiguityReport:
    found, matched = measured.solution.ambiguity, measured.matched
    if found.alternative is None:
        return AmbiguityReport(found.status)
    slopes = _slopes(found.alternative, matched, measured.options, measured.up)
    normals = surface_normals(found.alternative)
    planes = tuple(
        AlternativePlane(i + 1, normals[k], float(np.degrees(slopes.slope_rad[k])))
        for k, i in enumerate(matched.answered)
    )
    remedy = (
        "a third image, a known direction of motion, or more relief in view" if found.status == "unresolved" else None
    )
    motion = _motion(found.alternative, measured.length)
    return AmbiguityReport(found.status, found.delta_chi2, remedy, Alternative(motion, planes))


def _known(plane: Plane) -> bool:
    """Whether the matches say where the plane faces, and that it lies before the camera (NaN compares false)."""
    return plane.slope_sigma_deg <= UNKNOWN_DEG and plane.distance > 0


def _rejected(matched: Matched, planes: tuple[Plane, ...]) -> tuple[Rejected, ...]:
    """Windows without matches, and those whose matches leave the slope open."""
    bare = [
        Rejected(i + 1, window_polygon(window), match.code, match.reason)
        for i, (window, match) in enumerate(zip(matched.windows, matched.matches, strict=True))
        if match.origin == "none"
    ]
    vague = [
        Rejected(plane.id, plane.polygon_px, "low-texture", "too little texture: its matches leave the slope open")
        for plane in planes
        if not _known(plane)
    ]
    return tuple(sorted(bare + vague, key=lambda window: window.id))
