"""The model of the page: planes or ground of a map under image 1, in the viewer of trimesh, which needs no network."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from slopecli.ground.slope_map import SlopeMap
from slopecli.products.glb import LARGEST_TEXTURE_PX, model_from_camera1
from slopecli.products.page.page_tunables import PAGE
from slopecli.products.region_mesh import Surface, lay_on_plane, region_surfaces, window_surface
from slopecli.report.kinds import many_windows
from slopecli.types import Camera, FloatArray, Image, IntArray, Plane, Report

Part = tuple[FloatArray, FloatArray, IntArray]  # points (n, 3) in camera-1 axes, uv (n, 2) px of image 1, triangles


def viewer_of_report(report: Report, image: Image) -> str:
    """Return the viewer of the planes of a report as a page of HTML of its own; "" where there is nothing to show."""
    surfaces = region_surfaces(report, PAGE.model_triangles) if report.found else []
    given, camera = [plane for plane in report.planes if not plane.found], report.cameras[0]
    lay = _corners_alone if many_windows(report) else window_surface
    windows = (lay(plane, camera) for plane in given)
    shown = [*surfaces, *(surface for surface in windows if surface is not None)]
    return _viewer([(one.points, one.uv, one.triangles) for one in shown], report, image)


def _corners_alone(plane: Plane, camera: Camera) -> Surface | None:
    """A small window laid onto its plane in as few triangles as its corners have."""
    polygon = np.asarray(plane.polygon_px, float)
    fan = np.array([(0, i, i + 1) for i in range(1, len(polygon) - 1)])
    return lay_on_plane(plane, camera, polygon, fan)


def viewer_of_map(slope_map: SlopeMap, image: Image) -> str:
    """Return the viewer of the ground of a map; "" where none is known."""
    rows, columns = slope_map.slope_deg.shape
    step = max(1, int(np.ceil(np.sqrt(2.0 * rows * columns / PAGE.model_triangles))))
    points = slope_map.points[::step, ::step]
    i, j = np.indices(points.shape[:2])
    uv = (np.stack([j, i], -1) * step + 0.5) * slope_map.spacing_px - 0.5
    number = np.arange(points[..., 0].size).reshape(points.shape[:2])
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate([np.stack(corners, -1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])
    flat, known = points.reshape(-1, 3), np.isfinite(points).all(-1).ravel()
    triangles = triangles[known[triangles].all(1)]
    if not len(triangles):
        return ""
    used, numbered = np.unique(triangles, return_inverse=True)
    part = flat[used], uv.reshape(-1, 2)[used], numbered.reshape(-1, 3)
    return _viewer([part], slope_map.report, image)


def _viewer(parts: Sequence[Part], report: Report, image: Image) -> str:
    """The viewer of parts as HTML. Axes are those of patches.glb, y up, scaled so that the model fits a unit sphere."""
    if not parts:
        return ""
    import trimesh
    from trimesh.viewer import scene_to_html

    material = trimesh.visual.material.PBRMaterial(  # emissive: the light is in the picture already
        emissiveTexture=_texture(image), emissiveFactor=[1.0, 1.0, 1.0], baseColorFactor=[0, 0, 0, 255],
        metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True,
    )  # fmt: skip
    rotation = model_from_camera1(np.array(report.up.vector_cam1))
    turned = [points @ rotation.T for points, _, _ in parts]
    every = np.concatenate(turned)
    low, high = np.quantile(every, [0.01, 0.99], axis=0)
    centre = 0.5 * (low + high)
    size = max(0.5 * float(np.linalg.norm(high - low)), 1e-9)
    place = (np.concatenate([uv for _, uv, _ in parts]) + 0.5) / [image.width, image.height]
    place[:, 1] = 1.0 - place[:, 1]  # trimesh counts from below
    starts = np.cumsum([0, *(len(points) for points in turned[:-1])])
    triangles = np.concatenate([part[2] + start for part, start in zip(parts, starts, strict=True)])
    visual = trimesh.visual.TextureVisuals(uv=place, material=material)
    scene = trimesh.Scene()
    mesh = trimesh.Trimesh((every - centre) / size, triangles, visual=visual, process=False)
    scene.add_geometry(mesh, geom_name="ground", node_name="ground")
    scene.camera = trimesh.scene.Camera(name="camera", resolution=(640, 480), fov=(45.0, 34.0))
    scene.camera_transform = _oblique(2.6)
    return str(scene_to_html(scene))


def _oblique(distance: float) -> FloatArray:
    """(4, 4) place of the viewer's camera: looks ahead and down at the origin, 45 deg above the horizon."""
    back = np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)
    right = np.array([1.0, 0.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(back, right), back])
    pose[:3, 3] = distance * back
    return pose


def _texture(image: Image) -> Any:
    """Image 1 as a JPEG of Pillow, no larger than need be."""
    from PIL.JpegImagePlugin import JpegImageFile

    pixels = cv2.cvtColor(image.grey, cv2.COLOR_GRAY2BGR) if image.colour is None else image.colour
    scale = LARGEST_TEXTURE_PX / 2 / max(pixels.shape)
    if scale < 1.0:
        pixels = np.asarray(cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, PAGE.jpeg_quality])[1].tobytes()
    return JpegImageFile(io.BytesIO(encoded))
