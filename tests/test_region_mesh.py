"""Meshes of planes found as regions: the region's shape, on the plane, within reason."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from report_factory import make_camera, make_plane, make_region_labels, make_region_report, normal_of, rectangle

from slopecli.geometry import pixels_from_rays
from slopecli.products import MOST_TRIANGLES, region_grid, region_surfaces
from slopecli.types import Camera

DISTORTED = Camera(640, 480, 420.0, 421.0, 318.0, 242.0, "brown", (-0.28, 0.07, 2e-4, -1e-4))


def disc_with_hole(size: int = 200) -> np.ndarray:
    v, u = np.indices((size, size)) - size / 2
    return np.where((np.hypot(u, v) < 0.45 * size) & (np.hypot(u - 20, v) > 0.15 * size), 255, 0).astype(np.uint8)


def two_bars(size: int = 200) -> np.ndarray:
    mask = np.zeros((size, size), np.uint8)
    mask[:40], mask[160:, 30:] = 255, 255
    return mask


def slanting_strip(size: int = 200) -> np.ndarray:
    mask = np.zeros((size, size), np.uint8)
    cv2.line(mask, (10, 20), (190, 130), 255, 5)
    return mask


def covered(uv: np.ndarray, triangles: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Pixels whose centre lies in a triangle, at 1/16 px."""
    picture = np.zeros(shape, np.uint8)
    for triangle in uv[triangles]:
        cv2.fillPoly(picture, [np.rint(triangle * 16).astype(np.int32)], 255, cv2.LINE_8, 4)
    return picture


def areas(uv: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Positive for triangles that run counter-clockwise as seen, v down."""
    a, b, c = uv[triangles].transpose(1, 0, 2)
    return 0.5 * ((c - a)[:, 0] * (b - a)[:, 1] - (c - a)[:, 1] * (b - a)[:, 0])


@pytest.mark.parametrize("step", [1.0, 2.7, 4.0])
@pytest.mark.parametrize("mask", [disc_with_hole(), two_bars(), slanting_strip()], ids=["hole", "pieces", "strip"])
def test_grid_has_the_region_s_shape(mask: np.ndarray, step: float) -> None:
    corner = np.array([30, 70])
    box = np.s_[corner[1] : corner[1] + mask.shape[0], corner[0] : corner[0] + mask.shape[1]]
    uv, triangles = region_grid(mask, box, step)
    signed = areas(uv, triangles)
    assert signed.min() > 0
    assert signed.sum() == pytest.approx(cv2.countNonZero(mask), rel=0.03)
    mask = np.pad(mask, 4)
    drawn = covered(uv - corner + 4, triangles, mask.shape)
    outside, inside = (cv2.distanceTransform(m, cv2.DIST_L2, 5) for m in (255 - mask, mask))
    assert outside[drawn > 0].max() < 2
    assert inside[drawn == 0].max() < 2


def test_grids_of_neighbours_meet() -> None:
    """Two halves of a picture leave no gap and do not overlap, whatever the step."""
    for step in (1.0, 2.3, 3.9):
        left = region_grid(np.full((120, 61), 255, np.uint8), np.s_[0:120, 0:61], step)[0]
        right = region_grid(np.full((120, 90), 255, np.uint8), np.s_[0:120, 61:151], step)[0]
        assert left[:, 0].max() == pytest.approx(60.5, abs=0.3)
        assert right[:, 0].min() == pytest.approx(60.5, abs=0.3)


@pytest.mark.parametrize("camera", [make_camera(), DISTORTED], ids=["pinhole", "distorted"])
def test_surfaces_lie_on_their_planes_under_their_pixels(camera: Camera) -> None:
    report = make_region_report(camera)
    surfaces = region_surfaces(report)
    assert [surface.plane.id for surface in surfaces] == [1, 2, 3, 4, 5]
    for surface in surfaces:
        plane, points = surface.plane, surface.points
        assert np.abs(points @ plane.normal_cam1 + plane.distance).max() < 1e-9 * plane.distance
        np.testing.assert_allclose(pixels_from_rays(camera, points[:, :2] / points[:, 2:]), surface.uv, atol=1e-6)
        a, b, c = points[surface.triangles].transpose(1, 0, 2)
        assert (np.cross(b - a, c - a) @ plane.normal_cam1 > 0).all()  # fronts towards camera 1
        size = areas(surface.uv, surface.triangles).sum()
        assert size == pytest.approx(np.count_nonzero(report.labels == plane.id), rel=0.06)


def test_planes_given_by_polygons_or_without_pixels_have_no_surface() -> None:
    report = make_region_report()
    window = make_plane(6, rectangle(0, 0, 50, 50), 5.0)
    unseen = make_plane(7, rectangle(0, 0, 50, 50), 5.0, source="ransac")
    only = replace(report, planes=(window, unseen, replace(report.planes[1], source="ransac")))
    assert [surface.plane.id for surface in region_surfaces(only)] == [2]
    assert region_surfaces(replace(report, planes=())) == []


@pytest.mark.parametrize("specks", [0.0, 0.1])
def test_number_of_triangles_is_bounded_and_the_bound_made_use_of(specks: float) -> None:
    rng = np.random.default_rng(5)
    camera = make_camera(900, 700)
    labels = make_region_labels(900, 700)
    labels[rng.random(labels.shape) < specks] = 0
    surfaces = region_surfaces(make_region_report(camera, labels))
    count = sum(len(surface.triangles) for surface in surfaces)
    assert 0.5 * MOST_TRIANGLES < count <= MOST_TRIANGLES
    assert {surface.plane.id for surface in surfaces} == {1, 2, 3, 4, 5}


def test_ground_near_the_horizon_is_left_out() -> None:
    """A level camera: its ground reaches the horizon, and a wall stands at ten times the camera's height."""
    camera = make_camera()
    labels = np.zeros((480, 640), np.uint16)
    labels[200:] = 1
    labels[60:200, 100:500] = 2
    ground = make_plane(1, rectangle(0, 200, 639, 279), 0.0, camera=camera, source="region")
    ground = replace(ground, normal_cam1=np.array([0.0, -1.0, 0.0]), distance=1.0)
    wall = replace(ground, id=2, normal_cam1=np.array([0.0, 0.0, -1.0]), distance=10.0)
    report = make_region_report(camera, labels, planes=(ground, wall))
    surfaces = region_surfaces(report)
    assert [surface.plane.id for surface in surfaces] == [1, 2]
    near, far = (np.linalg.norm(surface.points, axis=1) for surface in surfaces)
    assert near.max() < 30 * far.min()
    assert surfaces[0].uv[:, 1].min() < 250  # no more is lost than the last rows before the horizon at 239.5
    assert surfaces[0].uv[:, 1].min() > 239.5


def test_plane_behind_the_camera_has_no_surface() -> None:
    report = make_region_report()
    behind = tuple(replace(plane, normal_cam1=-normal_of(10, 0)) for plane in report.planes)
    assert region_surfaces(replace(report, planes=behind)) == []


def test_pixels_the_lens_does_not_image_are_left_out() -> None:
    folded = Camera(640, 480, 300, 300, 320, 240, "brown", (-0.4,))
    for surface in region_surfaces(make_region_report(folded, np.ones((480, 640), np.uint16))):
        assert np.isfinite(surface.points).all()
        assert len(surface.triangles) > 1000
