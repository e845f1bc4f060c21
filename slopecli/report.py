"""From a solution in rays and baselines to what a user reads: slopes, verdicts, statuses, scale."""

from __future__ import annotations

from dataclasses import asdict
from typing import Literal

import numpy as np

from slopecli.diagnosis import diagnose, epipole1_px
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.homography import homography_in_pixels, homography_of_plane
from slopecli.geometry.metrics import rotation_angle
from slopecli.geometry.slope import measure_slopes, probability_below, slope_interval
from slopecli.options import Options
from slopecli.planes.joint import Matched
from slopecli.planes.window_match import WindowMatch
from slopecli.planes.windows import paint_labels, window_polygon
from slopecli.types import (
    Alternative,
    AlternativePlane,
    AmbiguityReport,
    Camera,
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
BORROWED_SIGMA_DEG = 5.0  # terrain next to a window tells its slope no better than this


def build_report(
    images: tuple[Image, Image],
    cameras: tuple[Camera, Camera],
    options: Options,
    matched: Matched,
    solution: Solution,
    diagnostics: list[Diagnostic],
) -> Report:
    """Assemble everything that is written and shown."""
    up, slopes = _slopes(solution, matched, options)
    scale, length = _scale(solution, matched, up, options)
    every = tuple(
        _plane(k, matched, solution, slopes, up, cameras, options, scale, length) for k in range(len(matched.answered))
    )
    planes = tuple(plane for plane in every if _known(plane))
    ids = [plane.id for plane in planes]
    relief = {plane.id: float(r) for plane, r in zip(every, solution.relief, strict=True)}
    epipole = epipole1_px(solution, cameras[0])
    shape = (images[0].height, images[0].width)
    return Report(
        images=(_info(images[0]), _info(images[1])),
        cameras=cameras,
        options=_options_dict(options),
        up=up,
        scale=scale,
        motion=_motion(solution, length),
        fit=_fit(solution, matched, cameras[1]),
        ambiguity=_ambiguity(solution, matched, up, length),
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


def dominant_plane(matched: Matched) -> int:
    """Index of the answered patch with the largest footprint."""
    areas = [matched.windows[i][2] * matched.windows[i][3] for i in matched.answered]
    return int(np.argmax(areas))


def _slopes(solution: Solution, matched: Matched, options: Options) -> tuple[Up, Slopes]:
    north = None if options.north is None else np.array(options.north, float)
    sigma = float(np.radians(options.up_sigma_deg))
    if options.up == "dominant-plane":
        k = dominant_plane(matched)
        slopes = measure_slopes(solution, None, sigma, north, up_plane=k)
        up = -solution.scaled_normals[k] / np.linalg.norm(solution.scaled_normals[k])
        return Up(_triple(up), "dominant-plane", options.up_sigma_deg), _doubted(slopes, matched)
    given = not isinstance(options.up, str)
    up = np.array(options.up if given else CAMERA_UP, float)
    up = up / np.linalg.norm(up)
    slopes = measure_slopes(solution, up, sigma, north)
    return Up(_triple(up), "given" if given else "camera", options.up_sigma_deg), _doubted(slopes, matched)


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


def _triple(v: FloatArray) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


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


def _plane(
    k: int,
    matched: Matched,
    solution: Solution,
    slopes: Slopes,
    up: Up,
    cameras: tuple[Camera, Camera],
    options: Options,
    scale: Scale,
    length: float,
) -> Plane:
    window, match = matched.windows[matched.answered[k]], matched.matches[matched.answered[k]]
    normal = solution.scaled_normals[k]
    member = matched.correspondences.patch == k
    kept = member & solution.inlier
    distance = _signed_distance(normal, matched.correspondences.x1[member], length)
    one = _only(slopes, k)
    low, high = np.degrees(slope_interval(one)[0])
    p_safe = float(probability_below(one, float(np.radians(options.tolerance_deg)))[0])
    aspect = None if np.isnan(one.aspect_rad[0]) else float(np.degrees(one.aspect_rad[0]))
    roughness = float(solution.relief[k])
    status, reason = _status(match, roughness, float(kept.sum() / max(member.sum(), 1)))
    return Plane(
        id=matched.answered[k] + 1,
        source="window",
        polygon_px=window_polygon(window),
        normal_cam1=-normal / np.linalg.norm(normal),
        distance=distance,
        slope_deg=float(np.degrees(one.slope_rad[0])),
        slope_sigma_deg=float(np.degrees(one.sigma_rad[0])),
        slope_ci95_deg=(float(low), float(high)),
        aspect_deg=aspect,
        dip_direction_deg=aspect,
        n_correspondences=int(member.sum()),
        n_inliers=int(kept.sum()),
        rms_px=_rms_px(solution, matched, kept, k, cameras[1].focal_px),
        roughness=roughness * distance if scale.unit == "m" else roughness,
        homography_px=_pixel_homography(solution, k, cameras),
        verdict=_verdict(p_safe, _alternative_p_safe(solution, k, up, options), status, options),
        p_safe=p_safe,
        status=status,
        reason=reason,
    )


def _signed_distance(normal: FloatArray, x1: FloatArray, length: float) -> float:
    """Perpendicular distance from camera 1, negative for a plane that mismatches have put behind it."""
    ahead = float(np.median(homogeneous(x1) @ normal)) > 0
    return (1 if ahead else -1) * length / float(np.linalg.norm(normal))


def _only(slopes: Slopes, k: int) -> Slopes:
    one = slice(k, k + 1)
    return Slopes(
        slopes.slope_rad[one],
        slopes.sigma_rad[one],
        slopes.aspect_rad[one],
        slopes.aspect_sigma_rad[one],
        slopes.tilt_covariance[one],
    )


def _status(match: WindowMatch, roughness: float, inlier_share: float) -> tuple[Literal["ok", "poor"], str | None]:
    if match.origin == "borrowed":
        return "poor", match.reason
    if roughness > ROUGH or inlier_share < 0.5:
        return "poor", "non-planar-patch"
    return "ok", None


def _alternative_p_safe(solution: Solution, k: int, up: Up, options: Options) -> float:
    """P(slope < tolerance) of the other root where it is not ruled out, else 1: a verdict must hold in both."""
    other = solution.ambiguity.alternative
    if solution.ambiguity.status != "unresolved" or other is None:
        return 1.0
    slopes = measure_slopes(other, np.array(up.vector_cam1), float(np.radians(up.sigma_deg)))
    return float(probability_below(_only(slopes, k), float(np.radians(options.tolerance_deg)))[0])


def _verdict(p_safe: float, p_other: float, status: str, options: Options) -> Verdict:
    """Safe only where the window itself was seen to be a plane, and in both answers where geometry leaves two."""
    if status == "ok" and min(p_safe, p_other) >= options.confidence:
        return "safe"
    best_case = max(p_safe, p_other if p_other < 1.0 else 0.0)
    return "unsafe" if best_case <= 1 - options.confidence else "undecided"


def _rms_px(solution: Solution, matched: Matched, kept: np.ndarray, k: int, focal_px: float) -> float:
    if not kept.any():
        return float("nan")
    H = homography_of_plane(solution.R, solution.T, solution.scaled_normals[k])
    y = homogeneous(matched.correspondences.x1[kept]) @ H.T
    residual = y[:, :2] / y[:, 2:] - matched.correspondences.x2[kept]
    return float(np.sqrt((residual**2).sum(1).mean() / 2)) * focal_px


def _pixel_homography(solution: Solution, k: int, cameras: tuple[Camera, Camera]) -> FloatArray:
    H = homography_of_plane(solution.R, solution.T, solution.scaled_normals[k])
    return homography_in_pixels(H, cameras[0].K, cameras[1].K)


def _ambiguity(solution: Solution, matched: Matched, up: Up, length: float) -> AmbiguityReport:
    found = solution.ambiguity
    if found.alternative is None:
        return AmbiguityReport(found.status)
    other = found.alternative
    slopes = measure_slopes(other, np.array(up.vector_cam1))
    normals = -other.scaled_normals / np.linalg.norm(other.scaled_normals, axis=1, keepdims=True)
    planes = tuple(
        AlternativePlane(i + 1, normals[k], float(np.degrees(slopes.slope_rad[k])))
        for k, i in enumerate(matched.answered)
    )
    remedy = (
        "a third image, a known direction of motion, or more relief in view" if found.status == "unresolved" else None
    )
    return AmbiguityReport(found.status, found.delta_chi2, remedy, Alternative(_motion(other, length), planes))


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
