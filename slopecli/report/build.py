"""From a solution in rays and baselines to what a user reads: planes with slope, verdict and status, scale, motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError, NoAnswer
from slopecli.findings.answer_checks import (
    NON_PLANAR,
    ROUGH,
    changed,
    diagnose,
    epipole1_px,
    measured_noise,
    of_geometry,
    unexplained,
)
from slopecli.findings.changes import Change
from slopecli.findings.unanswered import answered, causes, commonest, rejected
from slopecli.findings.wording import beside
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.homography import homography_in_pixels, homography_of_plane
from slopecli.geometry.metrics import rotation_angle
from slopecli.geometry.slope import surface_normals
from slopecli.geometry.statistics import median
from slopecli.measure import Measured, judge, measure, signed_distance
from slopecli.options import Options
from slopecli.patches.footprint import paint_labels
from slopecli.patches.given.given_solution import MOST_LEFT_OUT
from slopecli.patches.given.rows import RAYS
from slopecli.patches.join import Matched
from slopecli.patches.match import WindowMatch
from slopecli.report.second_root import second_plane, what_decides
from slopecli.types import (
    Alternative,
    AmbiguityReport,
    BoolArray,
    Camera,
    Diagnostic,
    Fit,
    FloatArray,
    Image,
    ImageInfo,
    Motion,
    Plane,
    Report,
    Scale,
    Solution,
    Source,
    Up,
)

# options of how images are matched and planes found
OF_IMAGES = {
    "grid", "windows", "planes", "min_region_percent", "gradient_threshold", "merge_px", "features", "seed",
}  # fmt: skip
LEAST_SEEN = 0.5  # share of a window that must be matched to speak for all of it
LEAST_WHOLE = 0.5  # of a plane found must lie in one piece: what cuts through many things at one height is no surface
UNSETTLED = "the joint solution did not settle"
LEVEL_LOOK = 0.05  # mean drop to the ground over its distance below which an altitude gives no scale


def build_report(
    images: tuple[Image | ImageInfo, Image | ImageInfo],
    cameras: tuple[Camera, Camera],
    options: Options,
    matched: Matched,
    solution: Solution,
    diagnostics: list[Diagnostic],
    changes: Sequence[Change] = (),
) -> Report:
    """Assemble everything that is written and shown.

    diagnostics : what was noted on the way.  changes : areas of image 1 that contradict the rest of the scene.

    Raises
    ------
    InputError : up or north is no direction, or an altitude is given for a camera that looks along the horizon.
    NoAnswer : the matches of all windows leave their slopes open.
    """
    main = measure(solution, matched, options)
    other = _second_root(solution, matched, options)
    scale, length = _scale(solution, matched, main.up, options)
    every = [_plane(k, main, other, matched, cameras, options) for k in range(len(matched.answered))]
    planes = tuple(_scaled(plane, scale, length) for plane in every if answered(plane))
    unknown = causes(every, main, matched, options)
    if not planes:
        cause, whose = commonest(unknown), f"all {len(matched.matches)} {matched.patches.noun}s"
        raise NoAnswer(cause.code, f"the matches of {whose} leave their slopes open: {cause.message}", cause.remedy)
    own = {plane.id: matched.matches[i] for i, plane in zip(matched.answered, every, strict=True)}
    relief = {plane.id: float(r) for plane, r in zip(every, solution.relief, strict=True)}
    epipole = epipole1_px(solution, cameras[0])
    length_m = length if scale.unit == "m" else None
    focal_px = None if cameras[1] is RAYS else cameras[1].focal_px
    fit = _fit(solution, matched, cameras[1])
    given = matched.patches.source == "given"
    noise = measured_noise(solution, matched.correspondences.patch) if given else solution.noise
    noise_px = fit.noise_px * noise / max(solution.noise, np.finfo(float).tiny)
    ids = [plane.id for plane in planes]
    labels = _labels(matched, every, ids, images[0])
    if matched.patches.found:
        diagnostics = [*diagnostics, unexplained(labels)]
    return Report(
        images=(_info(images[0]), _info(images[1])),
        cameras=cameras,
        options=_options_dict(options, matched.patches.source),
        up=main.up,
        scale=scale,
        motion=_motion(solution, length),
        fit=fit,
        ambiguity=_ambiguity(main, other, matched, planes, length, options),
        planes=planes,
        rejected=rejected(matched, every, unknown),
        diagnostics=(
            *diagnostics,
            *changed(changes, planes, labels),
            *of_geometry(planes, solution, matched.correspondences, length_m, focal_px, options, own, noise),
            *diagnose(planes, relief, solution, epipole, noise_px, labels),
        ),
        labels=labels,
        epipole1_px=epipole,
        segmentation=matched.patches.segmentation,
    )


def _labels(matched: Matched, every: list[Plane], ids: list[int], image: Image | ImageInfo) -> NDArray[np.uint16]:
    """(h, w) id of every pixel's plane; a user's own points have no pixels, and their planes any number."""
    if matched.patches.source == "given":
        return np.zeros((0, 0), np.uint16)
    shown = [matched.footprints[i] for i, plane in zip(matched.answered, every, strict=True) if plane.id in ids]
    return paint_labels(shown, ids, (image.height or 0, image.width or 0))


def _info(image: Image | ImageInfo) -> ImageInfo:
    return ImageInfo(image.path, image.width, image.height, image.sha256)


def _options_dict(options: Options, source: Source) -> dict[str, object]:
    """Those that had a say."""
    values = asdict(options)
    if source == "given":
        return {name: value for name, value in values.items() if name not in OF_IMAGES}
    # the grid speaks only where no windows are given
    values["grid" if options.windows else "windows"] = None
    return values


def _second_root(solution: Solution, matched: Matched, options: Options) -> Measured | None:
    """The other root, measured against its own up, where there is one."""
    other = solution.ambiguity.alternative
    return None if other is None else measure(other, matched, options)


def _scale(solution: Solution, matched: Matched, up: Up, options: Options) -> tuple[Scale, float]:
    """The unit of lengths, and how many of it a baseline is."""
    if options.pose is not None:
        return Scale("m", "pose"), float(np.linalg.norm(options.pose.baseline_m))
    if options.baseline_m is not None:
        return Scale("m", "baseline"), options.baseline_m
    if options.altitude_m is None:
        return Scale(), 1.0
    drops, distances = [], []
    for k in range(len(matched.answered)):
        rays = homogeneous(matched.correspondences.x1[matched.correspondences.patch == k])
        points = rays / (rays @ solution.scaled_normals[k])[:, None]
        drops.append(median(-points @ np.array(up.vector_cam1)))
        distances.append(median(np.linalg.norm(points, axis=1)))
    drop = median(drops)
    if drop < LEVEL_LOOK * median(distances):
        raise InputError(
            f"--altitude {options.altitude_m:g} needs ground below the camera, but against up {up.vector_cam1} what is "
            "seen lies level with it or above; give --up for this camera, or --baseline instead"
        )
    return Scale("m", "altitude"), options.altitude_m / drop


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
    # the solver's noise is that of a match of weight one; reported is that of the median match
    noise = solution.noise / float(np.sqrt(median(matched.weights)))
    return Fit(
        solver=solution.solver,
        refine="points",
        rms_px=_px(solution.rms, camera2),
        noise_px=_px(noise, camera2),
        iterations=solution.iterations,
        converged=solution.converged,
        n_correspondences=len(solution.inlier),
        n_inliers=int(solution.inlier.sum()),
        rms_mrad=_mrad(solution.rms, camera2),
        noise_mrad=_mrad(noise, camera2),
    )


def _px(residual: float, camera: Camera) -> float:
    """A residual in px, NaN where there is no camera."""
    return float("nan") if camera is RAYS else residual * camera.focal_px


def _mrad(residual: float, camera: Camera) -> float | None:
    """A residual in milliradians where there is no camera to give it in px."""
    return 1e3 * residual if camera is RAYS else None


def _plane(
    k: int, main: Measured, other: Measured | None, matched: Matched, cameras: tuple[Camera, Camera], options: Options
) -> Plane:
    """Patch k, its lengths in baselines."""
    solution, number = main.solution, matched.answered[k]
    match = matched.matches[number]
    member = matched.correspondences.patch == k
    kept = member & solution.inlier
    slope = main.numbers[k]
    inlier_share = float(kept.sum() / max(member.sum(), 1))
    doubts = _doubts(match, matched.patches.noun, float(solution.relief[k]), inlier_share)
    whole = matched.footprints[number].largest_share
    if not doubts and whole < LEAST_WHOLE:
        doubts = [f"scattered: its largest piece is {beside(100 * whole, 100 * LEAST_WHOLE)} % of it"]
    if not solution.converged:  # planes share its motion, so none of them is better than it
        doubts.append(UNSETTLED)
    sigma_deg = slope["slope_sigma_deg"]
    known = not sigma_deg > options.max_sigma_deg
    if not known:
        doubts.append(_too_vague(sigma_deg, options.max_sigma_deg))
    rival = other if solution.ambiguity.status == "unresolved" else None
    p_safe, p_other = float(main.p_safe[k]), None if rival is None else float(rival.p_safe[k])
    both_known = known and (rival is None or np.degrees(rival.slopes.sigma_rad[k]) <= options.max_sigma_deg)
    H = homography_of_plane(solution.R, solution.T, solution.scaled_normals[k])
    rms = _rms(H, matched, kept)
    return Plane(
        id=matched.patches.id_of(number),
        source=matched.patches.source,
        polygon_px=matched.footprints[number].polygon_px,
        normal_cam1=surface_normals(solution)[k],
        distance=signed_distance(solution.scaled_normals[k], matched.correspondences.x1[member]),
        **slope,
        n_correspondences=int(member.sum()),
        n_inliers=int(kept.sum()),
        rms_px=_px(rms, cameras[1]),
        rms_mrad=_mrad(rms, cameras[1]),
        roughness=_roughness(solution, k, matched.patches.source, options),
        homography_px=homography_in_pixels(H, cameras[0].K, cameras[1].K),
        verdict=judge(p_safe, p_other, both_known and not doubts, options.confidence),
        p_safe=p_safe if p_other is None else min(p_safe, p_other),
        status="poor" if doubts else "ok",
        reason="; ".join(doubts) or None,
        slope_known=known,
    )


def _roughness(solution: Solution, k: int, source: Source, options: Options) -> float:
    """Relief of a plane over its distance, NaN where it was not asked for.

    Points of a user's own are held coplanar where they can be, and only the joint solution tells relief from noise.
    """
    asked = options.solver == "mle" and (source != "given" or bool(solution.relief.any()))
    return float(solution.relief[k]) if asked else float("nan")


def _too_vague(sigma_deg: float, limit_deg: float) -> str:
    return f"sigma {beside(sigma_deg, limit_deg)}° is above --max-sigma {limit_deg:g}°"


def _rms(H: FloatArray, matched: Matched, kept: BoolArray) -> float:
    """RMS residual per coordinate of a plane's matches, normalised coordinates of image 2; NaN when none is kept."""
    if not kept.any():
        return float("nan")
    y = homogeneous(matched.correspondences.x1[kept]) @ H.T
    residual = y[:, :2] / y[:, 2:] - matched.correspondences.x2[kept]
    return float(np.sqrt((residual**2).mean()))


def _doubts(match: WindowMatch, noun: str, roughness: float, inlier_share: float) -> list[str]:
    """Why the plane of a patch should not be leaned on; empty when there is nothing against it."""
    if match.reason:  # borrowed, or of a user's own and not what they were said to be
        return [match.reason]
    if match.share < LEAST_SEEN:
        return [f"only {beside(100 * match.share, 100 * LEAST_SEEN)} % of the {noun} could be matched"]
    if roughness > ROUGH or match.left_out > MOST_LEFT_OUT or inlier_share < 1 - MOST_LEFT_OUT:
        return [NON_PLANAR]
    return []


def _scaled(plane: Plane, scale: Scale, length: float) -> Plane:
    """The plane with its lengths in the report's unit; roughness becomes a height only when that is metres."""
    distance = plane.distance * length
    roughness = plane.roughness * distance if scale.unit == "m" else plane.roughness
    return replace(plane, distance=distance, roughness=roughness)


def _ambiguity(
    main: Measured,
    other: Measured | None,
    matched: Matched,
    planes: tuple[Plane, ...],
    length: float,
    options: Options,
) -> AmbiguityReport:
    """Both answers, if there are two, and what would decide between them.

    planes : those reported.  length : of a baseline in the first answer, in the unit of the report.
    """
    found = main.solution.ambiguity
    if other is None:
        return AmbiguityReport(found.status)
    length = _second_length(other, matched, length, options)
    by_id = {plane.id: plane for plane in planes}
    every = [(k, matched.patches.id_of(i)) for k, i in enumerate(matched.answered)]
    kept = [(k, by_id[number]) for k, number in every if number in by_id]
    points = matched.correspondences
    seconds = [second_plane(k, plane, other, points.x1[points.patch == k], length, options) for k, plane in kept]
    firsts = np.array([plane.slope_deg for _, plane in kept])
    ways = what_decides(main.solution, firsts, np.array([plane.slope_deg for plane in seconds]))
    return AmbiguityReport(
        found.status,
        found.delta_chi2,
        found.delta_chi2_prior,
        ways if found.status == "unresolved" else None,
        Alternative(_motion(other.solution, length), tuple(seconds)),
    )


def _second_length(other: Measured, matched: Matched, length: float, options: Options) -> float:
    """Of a baseline in the second answer: an altitude says something else of it there, or nothing at all."""
    try:
        return _scale(other.solution, matched, other.up, options)[1]
    except InputError:
        return length
