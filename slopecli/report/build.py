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
from slopecli.look.matches import Matches
from slopecli.measure import Measured, judge, measure, signed_distance
from slopecli.options import Options
from slopecli.patches.footprint import paint_labels
from slopecli.patches.given.given_solution import MOST_LEFT_OUT
from slopecli.patches.given.rows import RAYS
from slopecli.patches.join import Joined
from slopecli.patches.patch import Patch
from slopecli.report.second_root import second_plane, what_decides
from slopecli.types import (
    Alternative,
    AmbiguityReport,
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
    joined: Joined,
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
    main = measure(solution, joined, options)
    other = _second_root(solution, joined, options)
    scale, length = _scale(solution, joined, main.up, options)
    every = [_plane(k, main, other, joined, cameras, options) for k in range(len(joined.patches))]
    planes = tuple(_scaled(plane, scale, length) for plane in every if answered(plane))
    unknown = causes(every, main, options)
    asked = [*joined.patches, *joined.unanswered]
    source = asked[0].source
    if not planes:
        cause, whose = commonest(unknown), f"all {len(asked)} {asked[0].noun}s"
        raise NoAnswer(cause.code, f"the matches of {whose} leave their slopes open: {cause.message}", cause.remedy)
    own = {patch.id: patch for patch in joined.patches}
    relief = {plane.id: float(r) for plane, r in zip(every, solution.relief, strict=True)}
    epipole = epipole1_px(solution, cameras[0])
    length_m = length if scale.unit == "m" else None
    focal_px = None if cameras[1] is RAYS else cameras[1].focal_px
    fit = _fit(solution, joined, cameras[1])
    noise = measured_noise(solution, joined.plane) if source == "given" else solution.noise
    noise_px = fit.noise_px * noise / max(solution.noise, np.finfo(float).tiny)
    labels = _labels(joined, {plane.id for plane in planes}, images[0])
    if asked[0].found:
        diagnostics = [*diagnostics, unexplained(labels)]
    return Report(
        images=(_info(images[0]), _info(images[1])),
        cameras=cameras,
        options=_options_dict(options, source),
        up=main.up,
        scale=scale,
        motion=_motion(solution, length),
        fit=fit,
        ambiguity=_ambiguity(main, other, joined, planes, length, options),
        planes=planes,
        rejected=rejected(joined, every, unknown),
        diagnostics=(
            *diagnostics,
            *changed(changes, planes, labels),
            *of_geometry(planes, solution, joined, length_m, focal_px, options, own, noise),
            *diagnose(planes, relief, solution, epipole, noise_px, labels),
        ),
        labels=labels,
        epipole1_px=epipole,
        segmentation=joined.segmentation,
    )


def _labels(joined: Joined, ids: set[int], image: Image | ImageInfo) -> NDArray[np.uint16]:
    """(h, w) id of every pixel's plane, of those with these ids; a user's own points have no pixels."""
    shown = [patch for patch in joined.patches if patch.id in ids]
    if any(patch.source == "given" for patch in shown):
        return np.zeros((0, 0), np.uint16)
    footprints = [patch.footprint for patch in shown]
    return paint_labels(footprints, [patch.id for patch in shown], (image.height or 0, image.width or 0))


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


def _second_root(solution: Solution, joined: Joined, options: Options) -> Measured | None:
    """The other root, measured against its own up, where there is one."""
    other = solution.ambiguity.alternative
    return None if other is None else measure(other, joined, options)


def _scale(solution: Solution, joined: Joined, up: Up, options: Options) -> tuple[Scale, float]:
    """The unit of lengths, and how many of it a baseline is."""
    if options.pose is not None:
        return Scale("m", "pose"), float(np.linalg.norm(options.pose.baseline_m))
    if options.baseline_m is not None:
        return Scale("m", "baseline"), options.baseline_m
    if options.altitude_m is None:
        return Scale(), 1.0
    drops, distances = [], []
    for patch, normal in zip(joined.patches, solution.scaled_normals, strict=True):
        rays = homogeneous(patch.matches.x1)
        points = rays / (rays @ normal)[:, None]
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


def _fit(solution: Solution, joined: Joined, camera2: Camera) -> Fit:
    # the solver's noise is that of a match of weight one; reported is that of the median match
    noise = solution.noise / float(np.sqrt(median(joined.weight)))
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
    k: int, main: Measured, other: Measured | None, joined: Joined, cameras: tuple[Camera, Camera], options: Options
) -> Plane:
    """Patch k, its lengths in baselines."""
    solution, patch = main.solution, joined.patches[k]
    member = joined.on(k)
    kept = member & solution.inlier
    slope = main.numbers[k]
    inlier_share = float(kept.sum() / max(member.sum(), 1))
    doubts = _doubts(patch, float(solution.relief[k]), inlier_share)
    whole = patch.footprint.largest_share
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
    rms = _rms(H, joined.matches.take(kept))
    return Plane(
        id=patch.id,
        source=patch.source,
        polygon_px=patch.footprint.polygon_px,
        normal_cam1=surface_normals(solution)[k],
        distance=signed_distance(solution.scaled_normals[k], patch.matches.x1),
        **slope,
        n_correspondences=int(member.sum()),
        n_inliers=int(kept.sum()),
        rms_px=_px(rms, cameras[1]),
        rms_mrad=_mrad(rms, cameras[1]),
        roughness=_roughness(solution, k, patch.source, options),
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


def _rms(H: FloatArray, matches: Matches) -> float:
    """RMS residual per coordinate of a plane's matches, normalised coordinates of image 2; NaN when there is none."""
    if not len(matches):
        return float("nan")
    y = homogeneous(matches.x1) @ H.T
    residual = y[:, :2] / y[:, 2:] - matches.x2
    return float(np.sqrt((residual**2).mean()))


def _doubts(patch: Patch, roughness: float, inlier_share: float) -> list[str]:
    """Why the plane of a patch should not be leaned on; empty when there is nothing against it."""
    if patch.reason:  # borrowed, or of a user's own and not what they were said to be
        return [patch.reason]
    if patch.share < LEAST_SEEN:
        return [f"only {beside(100 * patch.share, 100 * LEAST_SEEN)} % of the {patch.noun} could be matched"]
    if roughness > ROUGH or patch.left_out > MOST_LEFT_OUT or inlier_share < 1 - MOST_LEFT_OUT:
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
    joined: Joined,
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
    length = _second_length(other, joined, length, options)
    by_id = {plane.id: plane for plane in planes}
    kept = [(k, by_id[patch.id]) for k, patch in enumerate(joined.patches) if patch.id in by_id]
    seconds = [second_plane(k, plane, other, joined.patches[k].matches.x1, length, options) for k, plane in kept]
    firsts = np.array([plane.slope_deg for _, plane in kept])
    ways = what_decides(main.solution, firsts, np.array([plane.slope_deg for plane in seconds]))
    return AmbiguityReport(
        found.status,
        found.delta_chi2,
        found.delta_chi2_prior,
        ways if found.status == "unresolved" else None,
        Alternative(_motion(other.solution, length), tuple(seconds)),
    )


def _second_length(other: Measured, joined: Joined, length: float, options: Options) -> float:
    """Of a baseline in the second answer: an altitude says something else of it there, or nothing at all."""
    try:
        return _scale(other.solution, joined, other.up, options)[1]
    except InputError:
        return length
