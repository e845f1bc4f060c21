"""Pictures of the page: slope and its sigma over image 1, and image 2 as it would look from where image 1 was taken."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.ground.slope_map import SlopeMap
from slopecli.look.warp import NODE_STEP
from slopecli.products.drawing.canvas import Frame, map_frame, resized
from slopecli.products.drawing.classes import (
    STEP,
    UNKNOWN,
    Classes,
    cell_classes,
    classes_of,
    sigma_classes,
    slope_classes,
)
from slopecli.products.drawing.ground_marks import draw_sites, draw_tolerance_edge, spread
from slopecli.products.drawing.marks import Picture
from slopecli.products.drawing.outlines import footprints_of
from slopecli.products.drawing.placement import place_numbers
from slopecli.products.map_picture import painted
from slopecli.products.overlay import draw_labels
from slopecli.products.page.page_tunables import PAGE
from slopecli.report.kinds import many_windows
from slopecli.types import FloatArray, Image, Plane, Report


class ClassPicture(NamedTuple):
    """A picture and the classes of its colours, for a legend: (name, colour) each."""

    source: str
    legend: list[tuple[str, str]]


def data_uri(picture: Picture) -> str:
    """Return an RGB picture as a data: URI that holds it as JPEG."""
    encoded = cv2.imencode(
        ".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, PAGE.jpeg_quality]
    )[1]
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode("ascii")


def class_pictures(report: Report, image: Image) -> tuple[ClassPicture, ClassPicture]:
    """Draw slope and 1-sigma of every plane over image 1, with ids and the edge at the tolerance."""
    frame, classes, sigmas = map_frame(image), classes_of(report), sigma_classes()
    known = [plane for plane in report.planes if plane.slope_known]
    labels = np.asarray(
        cv2.resize(report.labels, (frame.width, frame.height), interpolation=cv2.INTER_NEAREST_EXACT), np.uint16
    )

    def shown(classes: Classes, value: Callable[[Plane], float | None]) -> NDArray[np.int16]:
        """The class (h, w) of every pixel, by a value of its plane."""
        table = np.full(int(report.labels.max(initial=0)) + 1, UNKNOWN, np.int16)
        values = [(plane.id, value(plane)) for plane in known if plane.id < len(table)]
        told = [(number, angle) for number, angle in values if angle is not None]
        if told:
            table[[number for number, _ in told]] = classes.of([angle for _, angle in told])
        return table[labels]

    slope = shown(classes, lambda plane: plane.slope_deg)
    sigma = shown(sigmas, lambda plane: plane.slope_sigma_deg)
    steep = slope >= (classes.steep_from or 0)
    both = []
    for cells, kinds in ((slope, classes), (sigma, sigmas)):
        picture = painted(image, frame, cells, kinds)
        draw_tolerance_edge(picture, steep, slope >= 0, 1.0, 2 * frame.text_px)
        both.append(ClassPicture(data_uri(_numbered(picture, report, frame)), _legend(kinds, cells)))
    return both[0], both[1]


def _numbered(picture: Picture, report: Report, frame: Frame) -> Picture:
    """A picture with the ids of the planes, unless they are too many to be read."""
    if many_windows(report):
        return picture
    shape = (frame.height, frame.width)
    footprints = footprints_of(report, frame.scale, shape, frame.text_px)
    return draw_labels(picture, place_numbers(footprints, shape, 2 * frame.text_px), 2 * frame.text_px)


def map_class_pictures(slope_map: SlopeMap, image: Image) -> tuple[ClassPicture, ClassPicture]:
    """Draw slope and 1-sigma of a map over image 1, with landing sites and the edge at the tolerance."""
    frame, classes, sigmas = map_frame(image), slope_classes(slope_map), sigma_classes()
    side = slope_map.spacing_px * frame.scale
    of_sigma = sigmas.of(np.where(slope_map.known, slope_map.sigma_deg, np.nan))
    kinds = ((cell_classes(slope_map, classes), classes), (of_sigma, sigmas))
    slope = spread(kinds[0][0], (frame.height, frame.width), side, UNKNOWN)
    both = []
    for cells, named in kinds:
        picture = painted(image, frame, spread(cells, (frame.height, frame.width), side, UNKNOWN), named)
        draw_tolerance_edge(picture, slope >= (classes.steep_from or 0), slope >= 0, side, 2 * frame.text_px)
        draw_sites(picture, slope_map.sites, frame)
        both.append(ClassPicture(data_uri(picture), _legend(named, cells)))
    return both[0], both[1]


def _legend(classes: Classes, cells: NDArray[np.int16]) -> list[tuple[str, str]]:
    """Names and colours of classes, and of what has none."""
    colours = [f"rgb({r},{g},{b})" for r, g, b in classes.colours.tolist()]
    entries = list(zip(classes.names, colours, strict=True))
    entries += [("step: no surface has this slope", "step")] * bool((cells == STEP).any())
    return entries + [("not known", "unknown")] * bool((cells == UNKNOWN).any())


# ---- image 2 seen from camera 1 ----


def seen_from_1(report: Report, image: Image, image2: Image) -> tuple[str, str]:
    """Return image 1, and image 2 as it would look from camera 1 if the ground were the planes found, as JPEG.

    Where no plane is, both are dark.
    """
    frame = map_frame(image)
    rays = _rays(report, frame)
    labels = cv2.resize(report.labels, (frame.width, frame.height), interpolation=cv2.INTER_NEAREST_EXACT)
    table = np.full((int(report.labels.max(initial=0)) + 1, 3), np.nan)
    for plane in report.planes:
        if plane.id < len(table):
            table[plane.id] = -np.asarray(plane.normal_cam1) / plane.distance
    inverse_depth = (rays * table[labels]).sum(-1)
    return _pair(report, image, image2, frame, rays, inverse_depth)


def map_seen_from_1(slope_map: SlopeMap, image: Image, image2: Image) -> tuple[str, str]:
    """The same of a map, whose ground is that in the middle of its cells."""
    frame = map_frame(image)
    depth = slope_map.points[..., 2].astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(depth > 0, 1.0 / depth, np.nan).astype(np.float32)
    rows, columns = inverse.shape
    at = [
        ((np.arange(n) + 0.5) / frame.scale / slope_map.spacing_px - 0.5).astype(np.float32)
        for n in (frame.width, frame.height)
    ]
    u, v = np.meshgrid(np.clip(at[0], 0, columns - 1), np.clip(at[1], 0, rows - 1))
    inside = np.asarray(cv2.remap(inverse, u, v, cv2.INTER_LINEAR, borderValue=float("nan")), float)
    return _pair(slope_map.report, image, image2, frame, _rays(slope_map.report, frame), inside)


def _rays(report: Report, frame: Frame) -> FloatArray:
    """(h, w, 3) rays (x, y, 1) of the pixels of a picture of image 1; interpolated between every eighth."""
    size = frame.width, frame.height
    counts = [max(2, -(-n // NODE_STEP) + 1) for n in size]
    u, v = np.meshgrid(*(np.linspace(0.0, n - 1.0, count) for n, count in zip(size, counts, strict=True)))
    uv1 = (np.stack([u, v], -1) + 0.5) / frame.scale - 0.5
    coarse = rays_from_pixels(report.cameras[0], uv1.reshape(-1, 2)).reshape(*u.shape, 2).astype(np.float32)
    across = np.linspace(0.0, counts[0] - 1.0, size[0], dtype=np.float32)
    down = np.linspace(0.0, counts[1] - 1.0, size[1], dtype=np.float32)
    fine = cv2.remap(coarse, *np.meshgrid(across, down), cv2.INTER_LINEAR)
    return homogeneous(np.asarray(fine, float).reshape(-1, 2)).reshape(*fine.shape[:2], 3)


def _pair(
    report: Report, image: Image, image2: Image, frame: Frame, rays: FloatArray, inverse_depth: FloatArray
) -> tuple[str, str]:
    """Both images, as data: URIs; inverse_depth (h, w): 1/z of the ground at every pixel, NaN where there is none."""
    motion, camera2 = report.motion, report.cameras[1]
    R = motion.rotation_cam2_from_cam1
    moved = rays @ R.T - inverse_depth[..., None] * (R @ motion.baseline_cam1)
    ahead = moved[..., 2] > 1e-6
    with np.errstate(invalid="ignore"):
        x2 = np.where(ahead[..., None], moved[..., :2] / np.where(ahead, moved[..., 2], 1.0)[..., None], np.nan)
    uv2 = pixels_from_rays(camera2, x2.reshape(-1, 2)).reshape(x2.shape)
    shown = np.isfinite(uv2).all(-1) & (inverse_depth > 0)
    shown &= (uv2 > -0.5).all(-1) & (uv2 < [image2.width - 0.5, image2.height - 0.5]).all(-1)
    at = np.where(shown[..., None], uv2, -9.0).astype(np.float32)
    warped = cv2.remap(image2.grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    own = resized(image.grey, frame.scale)
    level, contrast = own[shown].mean() if shown.any() else 0.0, own[shown].std() if shown.any() else 1.0
    other = warped.astype(np.float32)
    if shown.any():  # the exposure of image 2 shall not flicker
        other = (other - other[shown].mean()) * (contrast / max(float(other[shown].std()), 1.0)) + level
    grey = [own, np.clip(np.rint(other), 0, 255).astype(np.uint8)]
    first, second = (np.where(shown, one, own // 4).astype(np.uint8) for one in grey)
    return data_uri(np.dstack([first] * 3)), data_uri(np.dstack([second] * 3))
