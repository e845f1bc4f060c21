"""Assemble the report of a solution: planes, scale, motion, fit, second root and diagnostics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from slopecli.findings.camera_test import CameraTest
from slopecli.findings.checks import check_answer
from slopecli.findings.facts import AnswerFacts
from slopecli.findings.level_evidence import level_odds
from slopecli.findings.wording import forbidding
from slopecli.geometry.slope import aspects, north_direction
from slopecli.look.changes import Change
from slopecli.measure import measure
from slopecli.options import Options, Place
from slopecli.patches import FINDERS
from slopecli.patches.join import Joined
from slopecli.patches.patch import paint_labels
from slopecli.report.answered_planes import divide, planes_of
from slopecli.report.doubted_level import against_both, second_root_against_both
from slopecli.report.second_root import ambiguity_report
from slopecli.report.units import fit_of, in_unit, motion_of, scale_of
from slopecli.types import AlternativePlane, Camera, Diagnostic, Image, ImageInfo, Plane, Report, Solution, Up

# options of how images are matched and planes found
OF_IMAGES = {"planes", "features", "ply_frame", "seed"}.union(*(finder.options for finder in FINDERS))

_AnyPlane = TypeVar("_AnyPlane", Plane, AlternativePlane)


def build_report(
    images: tuple[Image | ImageInfo, Image | ImageInfo],
    cameras: tuple[Camera, Camera],
    options: Options,
    joined: Joined,
    solution: Solution,
    diagnostics: list[Diagnostic],
    changes: Sequence[Change] = (),
    test: CameraTest | None = None,
) -> Report:
    """Assemble everything that is written and shown.

    diagnostics : of the pair and the solution.  changes : areas of image 1 that changed.  test : of the cameras.

    Raises
    ------
    InputError : up or north is no direction, or an altitude is given for a camera that looks along the horizon.
    NoAnswer : the matches of all patches leave their slopes unknown.
    """
    main = measure(solution, joined, options)
    second = measure(other, joined, options) if (other := solution.ambiguity.alternative) else None
    scale, length = scale_of(main, joined, options)
    known, rejected = divide(planes_of(main, second, joined, cameras, options), main, joined, options)
    level = level_odds(main, joined, known, cameras[0], images[0].grey if isinstance(images[0], Image) else None)
    up, known = against_both(known, main, joined, options, level)
    planes = tuple(in_unit(plane, scale, length) for plane in known)
    labels, length_m = _labels(joined, planes, images[0]), length if scale.unit == "m" else None
    roots = ambiguity_report(main, second, joined, planes, length, options)
    facts = AnswerFacts(planes, solution, joined, cameras, options, labels, length_m, changes, level)
    return _in_doubt(
        Report(
            images=(_info(images[0]), _info(images[1])),
            cameras=cameras,
            options=_options_used(options, joined.patches[0].source),
            up=up,
            scale=scale,
            motion=motion_of(solution, length),
            fit=fit_of(solution, joined, cameras[1], test or CameraTest()),
            ambiguity=second_root_against_both(roots, second, joined, options, level),
            planes=planes,
            rejected=rejected,
            diagnostics=(*diagnostics, *check_answer(facts)),
            labels=facts.labels,
            epipole1_px=facts.epipole1_px,
            segmentation=joined.segmentation,
            place=_place(options, up),
        )
    )


def _in_doubt(report: Report) -> Report:
    """Withhold what a diagnostic forbids to rely on: a verdict safe becomes undecided, and P(safe) of what is
    undecided is none, in the second root too; the reason of a plane names the diagnostics.

    Slopes and sigmas stay as they are, and so does a verdict unsafe with its P(safe).
    """
    codes = list(dict.fromkeys(forbidding(report.diagnostics)))
    if not codes:
        return report
    planes = tuple(
        plane
        if plane.verdict is None
        else replace(_undecided(plane), reason="; ".join(filter(None, [plane.reason, *codes])))
        for plane in report.planes
    )
    ambiguity = report.ambiguity
    if second := ambiguity.alternative:
        ambiguity = replace(ambiguity, alternative=replace(second, planes=tuple(map(_undecided, second.planes))))
    return replace(report, planes=planes, ambiguity=ambiguity)


def _undecided(plane: _AnyPlane) -> _AnyPlane:
    """The plane undecided and without P(safe), unless it is unsafe or taken as level."""
    return plane if plane.verdict in ("unsafe", None) else replace(plane, verdict="undecided", p_safe=None)


def _place(options: Options, up: Up) -> Place | None:
    """Where camera 1 was and where north is from it; None where the options tell neither.

    Raises
    ------
    InputError : north is vertical.
    """
    if options.north is None:
        return None if options.position is None else Place(options.position)
    vertical = np.array(up.vector_cam1)
    north, ahead = (north_direction(vertical, given) for given in (np.array(options.north, float), None))
    x, y, z = (float(part) for part in north)
    heading = float(np.degrees(aspects(ahead[None], vertical, north)[0]))
    return Place(options.position, (x, y, z), heading, options.north_sigma_deg)


def _labels(joined: Joined, planes: Sequence[Plane], image: Image | ImageInfo) -> NDArray[np.uint16]:
    """(h, w) id of every pixel's plane; (0, 0) for a user's own points, which have no pixels."""
    if joined.patches[0].source == "given":
        return np.zeros((0, 0), np.uint16)
    ids = {plane.id for plane in planes}
    shown = {patch.id: patch.footprint for patch in joined.patches if patch.id in ids}
    return paint_labels([*shown.values()], [*shown], (image.height or 0, image.width or 0))


def _info(image: Image | ImageInfo) -> ImageInfo:
    return ImageInfo(image.path, image.width, image.height, image.sha256)


def _options_used(options: Options, source: str) -> dict[str, object]:
    """The options, without those that had no effect."""
    values = asdict(options)
    if source == "given":
        return {name: value for name, value in values.items() if name not in OF_IMAGES}
    values["grid" if options.windows else "windows"] = None  # windows given replace the grid
    return values
