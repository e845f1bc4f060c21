"""Which focal length the slopes are computed with: that given, or one that the images prefer, and its 1-sigma."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slopecli.findings.camera_test import TEST, Cameras, CameraTest
from slopecli.findings.wording import finding
from slopecli.geometry.solver.free_camera import FOCAL_STEPS
from slopecli.geometry.solver.seen_points import changed
from slopecli.options import Options
from slopecli.types import Camera, Diagnostic

FIELD_OF_VIEW = "field of view"  # source of a camera that is known to no better than `FIELD_OF_VIEW_PERCENT`
FIELD_OF_VIEW_PERCENT = 3.0  # 1-sigma of its focal length: data sheets round, and sensors are cropped


BETTER_KNOWN = "if you know it better, give it, and say by --focal-sigma how well"


class FocalUse(NamedTuple):
    """step : logarithm of the focal length used over that of the cameras.  sigma : its 1-sigma, 0 if it is exact."""

    step: float
    sigma: float


def prior_sigma(cameras: Cameras, options: Options) -> float:
    """1-sigma of the logarithm of the focal length as given; 0 if it is exact."""
    if options.focal_sigma_percent is not None:
        return options.focal_sigma_percent / 100.0
    return FIELD_OF_VIEW_PERCENT / 100.0 if any(camera.source.startswith(FIELD_OF_VIEW) for camera in cameras) else 0.0


def focal_to_use(test: CameraTest, prior: float, free: bool, contradicted: bool = False) -> FocalUse:
    """The focal length to use.

    prior : 1-sigma of the one given.  free : whether the images alone decide, where they tell it. Where they do not, a
    focal length that was to be free is known no better than they say, or than that it is one of those tried.
    contradicted : whether the images contradict the one given, so that one of the two sigmas does not hold: that of the
    mean is larger by as many times as they differ by their sigmas (Birge, 1932).
    """
    told = test.focal_factor is not None and test.score is not None
    own = float(np.hypot(test.sigma, test.floor))
    if free and told:
        return FocalUse(test.step, own)
    if free and not prior:
        return FocalUse(0.0, min(own, FOCAL_STEPS[-1] / np.sqrt(3.0)))
    if not prior or not told:
        return FocalUse(0.0, prior)
    both = 1.0 / np.sqrt(1.0 / prior**2 + 1.0 / own**2)
    if both >= TEST.systematic:  # the images do not know it better than the prior
        return FocalUse(0.0, prior)
    apart = abs(test.step) / float(np.hypot(prior, own)) if contradicted else 1.0
    return FocalUse(test.step * (both / own) ** 2, float(both) * max(apart, 1.0))


def refocused(cameras: Cameras, step: float) -> Cameras:
    """The cameras with the focal length used; their source says that it is not the one given."""
    if step == 0.0:
        return cameras
    first, second = (changed(camera, "f", step) for camera in cameras)
    return _freed(first), _freed(second)


def _freed(camera: Camera) -> Camera:
    note = ", focal length by the images"
    return camera if camera.source.endswith(note) else replace(camera, source=camera.source + note)


def _rounded(sigma_px: float) -> str:
    """A 1-sigma, with two digits."""
    return f"{sigma_px:.2g}" if sigma_px < 10.0 else f"{sigma_px:.0f}"


def focal_note(
    given: Cameras, used: Cameras, sigma: float, options: Options, told: bool = True, preferred_px: float | None = None
) -> list[Diagnostic]:
    """Say which focal length was used, if it is not the one given, or was to be freed and could not be.

    told : whether the images tell it, as they are matched now.  preferred_px : the one that the images prefer, where
    they contradict the one given, or agree with it if it was to be free.
    """
    if used[0] is given[0]:
        if not options.free_focal:
            return []
        if preferred_px is not None:
            best = f"the images prefer a focal length of {preferred_px:.5g} ± {_rounded(preferred_px * sigma)} px"
            less = f"the {given[0].focal_px:.5g} px given differ by less, so they were used"
            message = f"{best}, and {less}, as if known to {100.0 * sigma:.2g} %"
            return [finding("focal-length", message, 1.0)]
        message = "the images do not tell the focal length, so the one given was used, "
        message += f"as if it were known to {100.0 * sigma:.2g} %"
        return [finding("focal-length", message, 1.0, BETTER_KNOWN)]
    before, after = given[0].focal_px, used[0].focal_px
    known = _rounded(after * sigma)
    why = "that the images prefer (--free-focal)" if options.free_focal else "that images and --focal-sigma agree on"
    if options.free_focal and not told:
        why = "which --free-focal came to, but matched with it the images do not tell it"
    if preferred_px is not None:
        why = (
            f"the mean, weighted by their sigmas, of the {preferred_px:.4g} px that the images prefer and the one given"
        )
    message = (
        f"slopes were computed with a focal length of {after:.5g} ± {known} px, {why}: "
        f"{after / before:.4g} times the {before:.5g} px given; their sigmas include its own"
    )
    remedy = None if told else BETTER_KNOWN
    return [finding("focal-length", message, after / before, remedy)]
