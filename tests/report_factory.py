"""Reports made by hand, geometrically consistent, for tests of what is written from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from slopecli.patches import FINDER_OF
from slopecli.types import (
    Alternative,
    AlternativePlane,
    AmbiguityReport,
    Camera,
    Diagnostic,
    Fit,
    Image,
    ImageInfo,
    Motion,
    Plane,
    Rejected,
    Report,
    Scale,
    Segmentation,
    Up,
)

UP = np.array([0.0, 0.0, -1.0])
BASELINE = np.array([0.03, -0.02, 0.15])  # a descent, in units of the height, which is 1 at the image centre
TOLERANCE_DEG = 15.0
SLOPES_DEG = (4.0, 12.0, 22.0, 8.0, 15.5, 29.0, 2.0, 17.5, 10.0)
SIGMAS_DEG = (0.3, 0.5, 0.6, 0.2, 1.4, 0.9, 2.5, 0.4, 0.08)


def make_camera(width: int = 640, height: int = 480, **changes: object) -> Camera:
    """A camera with 60 degrees of horizontal view."""
    focal = width / 2 / math.tan(math.radians(30))
    values = {"fx": focal, "fy": focal, "cx": (width - 1) / 2, "cy": (height - 1) / 2, "source": "camera.json"}
    return Camera(width, height, **{**values, **changes})  # type: ignore[arg-type]


def make_image(width: int = 640, height: int = 480, *, colour: bool = False, seed: int = 0) -> Image:
    """Textured ground: noise at several scales."""
    rng = np.random.default_rng(seed)
    grey = np.full((height, width), 110.0)
    for step, amplitude in ((64, 35.0), (16, 25.0), (4, 18.0), (1, 8.0)):
        coarse = rng.normal(0.0, amplitude, (height // step + 2, width // step + 2))
        grey += np.kron(coarse, np.ones((step, step)))[:height, :width]
    pixels = np.clip(grey, 0, 255).astype(np.uint8)
    tinted = np.stack([pixels // 2, pixels, 255 - pixels // 3], axis=2) if colour else None
    return Image(pixels, tinted, "first.png", "0" * 64)


def normal_of(slope_deg: float, azimuth_deg: float) -> np.ndarray:
    """Unit normal towards camera 1 of a plane that falls towards an azimuth, clockwise from the image's up."""
    slope, azimuth = np.radians([slope_deg, azimuth_deg])
    return np.array([math.sin(slope) * math.sin(azimuth), -math.sin(slope) * math.cos(azimuth), -math.cos(slope)])


def rectangle(x: float, y: float, width: float, height: float) -> np.ndarray:
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]], float)


def grid_polygons(width: int, height: int, columns: int, rows: int, margin: int = 0) -> list[np.ndarray]:
    step = np.array([width / columns, height / rows])
    return [rectangle(*(step * [c, r] + margin), *(step - 2 * margin - 1)) for r in range(rows) for c in range(columns)]


def make_plane(
    plane_id: int,
    polygon: np.ndarray,
    slope_deg: float,
    sigma_deg: float = 0.5,
    azimuth_deg: float = 60.0,
    camera: Camera | None = None,
    **changes: object,
) -> Plane:
    """A plane through the ground point at height 1 under the middle of its polygon."""
    camera = camera or make_camera()
    normal = normal_of(slope_deg, azimuth_deg)
    middle = np.linalg.inv(camera.K) @ [*polygon.mean(axis=0), 1.0]
    distance = float(-normal @ middle)
    homography = camera.K @ (np.eye(3) + np.outer(BASELINE, normal) / distance) @ np.linalg.inv(camera.K)
    p_safe = 0.5 * math.erfc((slope_deg - TOLERANCE_DEG) / sigma_deg / math.sqrt(2))
    verdict = "safe" if p_safe >= 0.99 else "unsafe" if p_safe <= 0.01 else "undecided"
    level = slope_deg < 2 * sigma_deg
    values: dict[str, object] = {
        "id": plane_id,
        "source": "window",
        "polygon_px": polygon,
        "normal_cam1": normal,
        "distance": distance,
        "slope_deg": slope_deg,
        "slope_sigma_deg": sigma_deg,
        "slope_ci95_deg": (max(0.0, slope_deg - 1.96 * sigma_deg), slope_deg + 1.96 * sigma_deg),
        "aspect_deg": None if level else azimuth_deg,
        "dip_direction_deg": None if level else azimuth_deg,
        "n_correspondences": 140,
        "n_inliers": 131,
        "rms_px": 0.21,
        "roughness": 0.004,
        "homography_px": homography / homography[2, 2],
        "verdict": verdict,
        "p_safe": p_safe,
    }
    finder = FINDER_OF[str(changes.get("source", "window"))]
    values |= {"noun": finder.noun, "found": finder.found}
    return Plane(**{**values, **changes})  # type: ignore[arg-type]


def make_planes(camera: Camera, polygons: Sequence[np.ndarray]) -> tuple[Plane, ...]:
    count = len(SLOPES_DEG)
    return tuple(
        make_plane(i + 1, polygon, SLOPES_DEG[i % count], SIGMAS_DEG[i % count], 40.0 * i % 360, camera)
        for i, polygon in enumerate(polygons)
    )


def make_labels(camera: Camera, planes: Sequence[Plane]) -> np.ndarray:
    labels = np.zeros((camera.height, camera.width), np.uint16)
    for plane in planes:
        (left, top), (right, bottom) = plane.polygon_px.min(axis=0), plane.polygon_px.max(axis=0)
        labels[math.ceil(top) : int(bottom) + 1, math.ceil(left) : int(right) + 1] = plane.id
    return labels


def make_report(
    camera: Camera | None = None, polygons: Sequence[np.ndarray] | None = None, **changes: object
) -> Report:
    """Nine windows in camera 1; the last one is refused. `changes` replace fields of the report."""
    camera = camera or make_camera()
    outlines = grid_polygons(camera.width, camera.height, 3, 3) if polygons is None else list(polygons)
    answered, refused = (outlines, []) if len(outlines) == 1 else (outlines[:-1], outlines[-1:])
    planes = make_planes(camera, answered)
    info = ImageInfo("first.png", camera.width, camera.height, "0" * 64)
    epipole = camera.K @ BASELINE / BASELINE[2]
    values: dict[str, object] = {
        "images": (info, ImageInfo("second.png", camera.width, camera.height, "f" * 64)),
        "cameras": (camera, camera),
        "options": {"planes": "windows", "grid": (3, 3), "tolerance_deg": TOLERANCE_DEG, "confidence": 0.99, "seed": 0},
        "up": Up((0.0, 0.0, -1.0), "camera"),
        "scale": Scale(),
        "motion": Motion(np.eye(3), BASELINE / np.linalg.norm(BASELINE), 0.0, 0.01, 0.05),
        "fit": Fit("mle", "points", 0.22, 0.2, 7, True, 1260, 1170),
        "ambiguity": AmbiguityReport("none"),
        "planes": planes,
        "rejected": tuple(
            Rejected(len(planes) + 1, polygon, "low-texture", "12 correspondences; 20 are needed")
            for polygon in refused
        ),
        "diagnostics": (
            Diagnostic("low-parallax", "warning", "median parallax 3.1 px", 3.1, "take a longer baseline"),
        ),
        "labels": make_labels(camera, planes),
        "epipole1_px": (float(epipole[0]), float(epipole[1])),
    }
    return Report(**{**values, **changes})  # type: ignore[arg-type]


def taken_as_level(plane: Plane) -> Plane:
    """The plane as that which defines what is level."""
    nothing = {"slope_sigma_deg": None, "slope_ci95_deg": None, "aspect_deg": None, "dip_direction_deg": None}
    reason = "; ".join(part for part in ("taken-as-level", plane.reason) if part)
    return replace(plane, slope_deg=0.0, verdict=None, p_safe=None, reason=reason, **nothing)  # type: ignore[arg-type]


def with_level_plane(report: Report) -> Report:
    """The report with its first plane taken as level."""
    first, *others = report.planes
    return replace(
        report, planes=(taken_as_level(first), *others), up=Up((0.0, 0.0, -1.0), "dominant-plane", 0.0, first.id)
    )


def make_region_labels(width: int = 640, height: int = 480) -> np.ndarray:
    """Planes of every shape: 1 the ground with a pond in it, 2 a wall round a window 3, 4 in two pieces, 5 tiny."""
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    labels = np.zeros((height, width), np.uint16)
    labels[v > 0.62] = 1
    labels[np.hypot((u - 0.7) * width, (v - 0.82) * height) < 0.1 * height] = 0
    labels[(v > 0.1) & (v < 0.58) & (u > 0.05) & (u < 0.45)] = 2
    labels[(v > 0.2) & (v < 0.5) & (u > 0.12) & (u < 0.3)] = 3
    labels[(v > 0.1) & (v < 0.58) & (u > 0.5) & (u < 0.9) & ~((u > 0.73) & (u < 0.78))] = 4
    labels[(v > 0.2) & (v < 0.24) & (u > 0.94) & (u < 0.965)] = 5
    return labels


def make_region_report(
    camera: Camera | None = None, labels: np.ndarray | None = None, source: str = "region", **changes: object
) -> Report:
    """Planes found as the pixels of a label map; `changes` replace fields of the report."""
    camera = camera or make_camera()
    labels = make_region_labels(camera.width, camera.height) if labels is None else labels
    count = len(SLOPES_DEG)
    planes = tuple(
        make_plane(
            i, outline_of(labels, i), SLOPES_DEG[i % count], SIGMAS_DEG[i % count], 40.0 * i, camera, source=source
        )
        for i in np.unique(labels[labels > 0]).tolist()
    )
    options = {"planes": "regions", "tolerance_deg": TOLERANCE_DEG, "confidence": 0.99, "seed": 0}
    fields: dict[str, object] = {
        "planes": planes,
        "rejected": (),
        "labels": labels,
        "options": options,
        "epipole1_px": None,
    }
    return make_report(camera, [], **{**fields, **changes})


def outline_of(labels: np.ndarray, label: int) -> np.ndarray:
    """Outline of the largest piece."""
    contours, _ = cv2.findContours((labels == label).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return max(contours, key=cv2.contourArea).reshape(-1, 2).astype(float)


def make_segmentation(labels: np.ndarray, width: int, threshold: float = 3.0) -> Segmentation:
    """Steps that end in a label map, on a working image of another width: steep along the borders, pieces apart."""
    height = round(labels.shape[0] * width / labels.shape[1])
    merged = cv2.resize(labels, (width, height), interpolation=cv2.INTER_NEAREST).astype(np.int32)
    same = np.full(merged.shape, True)
    same[:, 1:] &= merged[:, 1:] == merged[:, :-1]
    same[1:] &= merged[1:] == merged[:-1]
    gradient = np.where(same, 0.4 * threshold, 4.0 * threshold).astype(np.float32)
    components = np.zeros_like(merged)
    for label in range(1, merged.max() + 1):
        count, pieces = cv2.connectedComponents(((merged == label) & same).astype(np.uint8), connectivity=4)
        components[pieces > 0] = components.max() + pieces[pieces > 0]
        assert count > 1, "a region of one pixel's width has no inside"
    return Segmentation(gradient, threshold, components, merged)


def make_ambiguity(report: Report) -> AmbiguityReport:
    """A second answer that fits as well: every slope mirrored to 20 degrees steeper."""
    planes = tuple(
        AlternativePlane(
            id=plane.id,
            normal_cam1=normal_of(plane.slope_deg + 20, 10.0),
            distance=plane.distance,
            slope_deg=plane.slope_deg + 20,
            slope_sigma_deg=0.7,
            slope_ci95_deg=(plane.slope_deg + 18.6, plane.slope_deg + 21.4),
            aspect_deg=10.0,
            dip_direction_deg=10.0,
            verdict="unsafe",
            p_safe=0.0,
        )
        for plane in report.planes
    )
    second = Alternative(report.motion, planes)
    return AmbiguityReport("unresolved", 1.3, resolve_with="a third image, or a known altitude", alternative=second)
