"""What a camera means, in numbers: field of view, focal length, principal point, distortion at the corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.findings.camera_checks import unlikely
from slopecli.geometry.camera import (
    padded_coefficients,
    pinhole_of,
    pixels_from_rays,
    rays_from_pixels,
    share_with_rays,
)
from slopecli.geometry.epipolar import homogeneous
from slopecli.types import Camera, FloatArray

LENSES = {
    "pinhole": "no distortion",
    "brown": "radial-tangential (Brown)",
    "fisheye": "equidistant fisheye",
    "polynomial": "radial-tangential to order 8, with skew",
    "cahvor": "radial about a tilted axis (CAHVOR)",
    "division": "radial, by division",
}
COEFFICIENTS = {
    "pinhole": "",
    "brown": "k1 k2 p1 p2 k3 k4 k5 k6",
    "fisheye": "k1 k2 k3 k4",
    "polynomial": "k1 k2 p1 p2 k3 k4 skew",
    "cahvor": "R0 R1 R2 tilt_x tilt_y linearity skew",
    "division": "k",
}
EDGES = ("the left or right edge", "the upper or lower edge", "the corners")
CORNERS = ("upper left", "upper right", "lower right", "lower left")


@dataclass(frozen=True)
class CameraFacts:
    """What is told of a camera; None where the lens has no ray.

    horizontal_deg, vertical_deg, diagonal_deg : fields of view between the outer edges of the image.
    focal_px, focal_widths : geometric mean focal length, px and in image widths.
    offset_px : (2,) of the principal point from the middle of the image.
    corner_shift_px : (4, 2) of the centres of the corner pixels, clockwise from the upper left: from where a camera of
        the same intrinsics without distortion would show the same rays, to where they are.
    corner_deg : (4,) angles off the axis of the image plane's normal.
    coefficients : names and values of the lens.
    seen : share of the image that has rays.  doubt : why hardly any camera is like this, or "".
    """

    camera: Camera
    horizontal_deg: float | None
    vertical_deg: float | None
    diagonal_deg: float | None
    focal_px: float
    focal_widths: float
    offset_px: tuple[float, float]
    corner_shift_px: tuple[tuple[float, float] | None, ...]
    corner_deg: tuple[float | None, ...]
    coefficients: tuple[tuple[str, float], ...]
    seen: float
    doubt: str


def camera_facts(camera: Camera) -> CameraFacts:
    """The facts of a camera whose image size is known."""
    width, height = camera.width, camera.height
    right, bottom, middle = width - 0.5, height - 0.5, ((width - 1) / 2, (height - 1) / 2)
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], float)
    shifts = corner_shifts(camera, corners)
    rays = rays_from_pixels(camera, corners)
    off_axis = np.degrees(np.arctan(np.hypot(*rays.T)))
    names = COEFFICIENTS[camera.model].split()
    return CameraFacts(
        camera,
        _angle_between(camera, (-0.5, middle[1]), (right, middle[1])),
        _angle_between(camera, (middle[0], -0.5), (middle[0], bottom)),
        _angle_between(camera, (-0.5, -0.5), (right, bottom)),
        camera.focal_px,
        camera.focal_px / width,
        (camera.cx - middle[0], camera.cy - middle[1]),
        tuple((float(u), float(v)) if np.isfinite(u) else None for u, v in shifts),
        tuple(float(angle) if np.isfinite(angle) else None for angle in off_axis),
        tuple(zip(names, padded_coefficients(camera), strict=True)),
        share_with_rays(camera),
        unlikely(camera),
    )


def corner_shifts(camera: Camera, uv: FloatArray) -> FloatArray:
    """Shifts (n, 2), px, by distortion of pixels uv (n, 2) as stored; NaN where the lens has no ray."""
    return uv - pixels_from_rays(pinhole_of(camera), rays_from_pixels(camera, uv))


def _angle_between(camera: Camera, one: tuple[float, float], other: tuple[float, float]) -> float | None:
    """Angle between the rays of two places of the image, deg; None where one has none."""
    first, second = homogeneous(rays_from_pixels(camera, np.array([one, other])))
    angle = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)))
    return angle if np.isfinite(angle) else None


def camera_lines(facts: CameraFacts, converted: str = "") -> list[str]:
    """The facts in words, a line each; `converted` names the conventions that were converted."""
    camera = facts.camera
    mm = 36 * facts.focal_widths
    terms = ", ".join(f"{name} {value:.6g}" for name, value in facts.coefficients if value)
    lines = [
        f"format           {camera.source}",
        f"image            {camera.width}x{camera.height} px"
        + ("" if camera.size_given else ", which the file does not say"),
        f"field of view    {_view(facts)}",
        f"focal length     {camera.fx:.6g} x {camera.fy:.6g} px, {facts.focal_widths:.4g} image widths "
        f"({mm:.3g} mm on a sensor 36 mm wide)",
        f"principal point  {camera.cx:.6g}, {camera.cy:.6g} px, {_off_middle(facts)}",
        f"lens             {LENSES[camera.model]}" + (f": {terms}" if terms else ""),
    ]
    if camera.model != "pinhole":
        corners = list(zip(CORNERS, facts.corner_shift_px, facts.corner_deg, strict=True))
        shifts = "; ".join(_corner(*corner) for corner in corners if corner[1] is not None)
        lines.append(f"distortion       {shifts or 'no corner has a ray'}")
        lines.append(f"with rays        {100 * facts.seen:.3g} % of the image")
    if converted:
        lines.append(f"converted        {converted}")
    lines += [f"note             {camera.note}"] if camera.note else []
    return lines + ([f"in doubt         {facts.doubt}; no verdict is safe with it"] if facts.doubt else [])


def _off_middle(facts: CameraFacts) -> str:
    sides = facts.camera.width, facts.camera.height
    if max(map(abs, facts.offset_px)) < 0.005:  # not shown in hundredths
        return "in the middle of the image"
    share = [100 * off / side for off, side in zip(facts.offset_px, sides, strict=True)]
    return (
        f"{facts.offset_px[0]:+.2f}, {facts.offset_px[1]:+.2f} px off the middle ({share[0]:+.2g}, {share[1]:+.2g} %)"
    )


def _view(facts: CameraFacts) -> str:
    ways = ("wide", facts.horizontal_deg), ("high", facts.vertical_deg), ("from corner to corner", facts.diagonal_deg)
    known = ", ".join(f"{angle:.4g}° {way}" for way, angle in ways if angle is not None)
    blind = [edges for edges, (_, angle) in zip(EDGES, ways, strict=True) if angle is None]
    none = f"no rays at {' and '.join(blind)}" if blind else ""
    return "; ".join(filter(None, (known, none)))


def _corner(name: str, shift: tuple[float, float] | None, angle: float | None) -> str:
    if shift is None or angle is None:
        return f"{name} no ray"
    return f"{name} {np.hypot(*shift):.4g} px at {angle:.3g}°"
