"""Checks of cameras by themselves: whether a camera is like those that are made."""

from __future__ import annotations

import math
from dataclasses import replace

from slopecli.findings.wording import finding
from slopecli.geometry.camera import OFF_MIDDLE, share_with_rays
from slopecli.types import Camera, Diagnostic

FOCAL_WIDTHS = (0.3, 25.0)  # of the longer side: fields of view of 118 and 2.3 degrees
ASPECT_APART = 0.03  # by which fx and fy of calibrations hardly ever differ
SIZELESS_OFF = 0.11  # the least share by which another image size changes both sides; 5:4 is 0.25

REMEDY_CROPPED = (
    "check the image size that the camera is for, and the unit of cx, cy (pixels from the first one); of a cropped "
    "image take the slopes, and judge safety yourself"
)


def implausible_cameras(camera1: Camera, camera2: Camera) -> list[Diagnostic]:
    """Warn of cameras of a pair as hardly any are made, once of two that are the same."""
    found = []
    for number, camera in enumerate((camera1, camera2), 1):
        if number == 2 and camera == camera1:
            continue
        if why := unlikely(camera):
            whose = "the camera" if camera1 == camera2 else f"camera {number}"
            remedy = REMEDY_CROPPED if "principal point" in why else None
            found.append(finding("implausible-camera", f"{whose}: {why}", float(number), remedy))
    return found


def with_aspect(found: list[Diagnostic], camera: Camera) -> list[Diagnostic]:
    """The same, where the camera is suspected with a word on focal lengths that differ.

    One of the two being wrong leaves a mark like that of a focal length or a lens, and those are named.
    """
    apart = max(camera.fx / camera.fy, camera.fy / camera.fx) - 1.0
    if apart < ASPECT_APART:
        return found
    words = (
        f"check fx and fy first: {camera.fx:.5g} and {camera.fy:.5g} px differ by {100 * apart:.2g} %, and pixels are "
        "square in nearly every camera; "
    )
    suspicions = ("suspect-camera", "suspect-distortion")
    return [replace(one, remedy=words + (one.remedy or "")) if one.code in suspicions else one for one in found]


def unlikely(camera: Camera) -> str:
    """What is unlikely about a camera, "" for most cameras that are made, and for one without an image size."""
    if not camera.width:
        return ""
    return _focal(camera) or _size(camera) or _centre(camera) or _lens(camera)


def _focal(camera: Camera) -> str:
    low, high = (share * max(camera.width, camera.height) for share in FOCAL_WIDTHS)
    for name, value in (("fx", camera.fx), ("fy", camera.fy)):
        if camera.model in ("fisheye", "cahvor") or low <= value <= high:
            continue
        view = 2 * math.degrees(math.atan(max(camera.width, camera.height) / 2 / value))
        unit = "is it in millimetres?" if value < low else "is a field of view in radians, or another unit, behind it?"
        return f"{name} = {value:.6g} px is a field of view of {view:.3g}° ({unit})"
    ratio = max(camera.fx / camera.fy, camera.fy / camera.fx)
    if ratio > 1.5:
        return f"fx = {camera.fx:.6g} and fy = {camera.fy:.6g} px would be pixels {ratio:.2g} times as long as wide"
    return ""


def _size(camera: Camera) -> str:
    """What tells that a camera without an image size of its own is for another size than the image's."""
    if camera.size_given:
        return ""
    middle = 2 * camera.cx + 1, 2 * camera.cy + 1
    misfits = [m / side - 1 for m, side in zip(middle, (camera.width, camera.height), strict=True)]
    low, high = sorted(map(abs, misfits))
    # another size moves both sides alike, or one by much; an ideal camera tells its size to the pixel
    resized = misfits[0] * misfits[1] > 0 and low > SIZELESS_OFF and high > 2 * SIZELESS_OFF
    ideal = high > 0.03 and all(m % 8 in (0, 1) for m in middle)
    if not (resized or ideal or high > 3 * SIZELESS_OFF):
        return ""
    return (
        f"it comes without an image size, and its principal point ({camera.cx:.6g}, {camera.cy:.6g}) is the middle of "
        f"{middle[0]:.0f}x{middle[1]:.0f} px, not of {camera.width}x{camera.height} px{_unit(camera)}"
    )


def _centre(camera: Camera) -> str:
    for name, place, side in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        off = abs(place - (side - 1) / 2) / side
        if off <= OFF_MIDDLE:
            continue
        what = "width" if name == "cx" else "height"
        where = f"{100 * off:.0f} % of the {what} off the middle of {camera.width}x{camera.height} px"
        return f"the principal point {name} = {place:.6g} is {where}{_unit(camera)}"
    return ""


def _unit(camera: Camera) -> str:
    """What the unit of a principal point near the first pixel may be."""
    small = max(abs(camera.cx), abs(camera.cy)) <= 1
    return "; are cx, cy shares of the image, or measured from its middle?" if small else ""


def _lens(camera: Camera) -> str:
    least = 0.2 if camera.model in ("fisheye", "cahvor") else 0.5  # a fisheye's image may be a small disc
    if camera.model == "pinhole" or (seen := share_with_rays(camera)) >= least:
        return ""
    return f"its distortion leaves only {100 * seen:.0f} % of the image with rays"
