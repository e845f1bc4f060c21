"""Lens models: exact both ways, equal to OpenCV, honest where they have no inverse."""

import cv2
import numpy as np
import pytest

from slopecli.errors import InputError
from slopecli.geometry import (
    OUTSIDE_PX,
    pinhole_of,
    pixels_from_rays,
    points_on_plane,
    rays_from_pixels,
    scale_camera,
    undistortion_maps,
)
from slopecli.types import Camera

EUROC = Camera(
    752, 480, 458.654, 457.296, 367.215, 248.375, "brown", (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)
)
CHESS = Camera(640, 480, 533.4, 533.4, 342.5, 234.7, "brown", (-0.281972, 0.038865, 0.001209, -0.000126, 0.119073))
RATIONAL = Camera(1280, 960, 600, 610, 640, 480, "brown", (5.3, 3.2, 0.0003, -0.0002, 0.2, 5.6, 4.8, 0.9))
FISHEYE = Camera(848, 800, 286, 287, 420, 400, "fisheye", (-0.0076, 0.0425, -0.0404, 0.0075))
IDEAL_FISHEYE = Camera(848, 800, 286, 287, 420, 400, "fisheye", ())
PINHOLE = Camera(1024, 768, 800, 810, 511.5, 383.5)
# 1 + 3 k1 r^2 = 0: the polynomial folds at r = 0.913, inside this image
FOLDED = Camera(640, 480, 300, 300, 320, 240, "brown", (-0.4,))
FOLD_RADIUS = np.sqrt(1 / 1.2)

CAMERAS = {
    "pinhole": PINHOLE,
    "euroc": EUROC,
    "chess": CHESS,
    "rational": RATIONAL,
    "fisheye": FISHEYE,
    "ideal-fisheye": IDEAL_FISHEYE,
    "folded": FOLDED,
}
camera_cases = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())


def pixels_of(camera: Camera, n: int = 2000) -> np.ndarray:
    rng = np.random.default_rng(7)
    uv = rng.uniform((0, 0), (camera.width - 1, camera.height - 1), (n, 2))
    uv[0] = camera.cx, camera.cy
    return uv


def opencv_pixels(camera: Camera, x: np.ndarray) -> np.ndarray:
    points = np.column_stack([x, np.ones(len(x))])[:, None]
    none = np.zeros(3)
    if camera.model == "fisheye":
        k = np.array(camera.distortion or (0.0,) * 4)
        return cv2.fisheye.projectPoints(points, none, none, camera.K, k)[0].reshape(-1, 2)
    k = np.zeros(8)
    k[: len(camera.distortion)] = camera.distortion
    return cv2.projectPoints(points, none, none, camera.K, k)[0].reshape(-1, 2)


@camera_cases
def test_round_trip_is_exact(camera: Camera) -> None:
    uv = pixels_of(camera)
    x = rays_from_pixels(camera, uv)
    seen = np.isfinite(x).all(axis=1)
    assert seen.mean() > 0.3
    assert np.abs(pixels_from_rays(camera, x[seen]) - uv[seen]).max() < 1e-10


@camera_cases
def test_projection_is_opencvs(camera: Camera) -> None:
    uv = pixels_of(camera)
    x = rays_from_pixels(camera, uv)
    x = x[np.isfinite(x).all(axis=1)]
    assert np.abs(pixels_from_rays(camera, x) - opencv_pixels(camera, x)).max() < 1e-10


def test_fisheye_undistortion_is_opencvs() -> None:
    uv = pixels_of(FISHEYE)
    uv = uv[np.hypot(*(uv - (FISHEYE.cx, FISHEYE.cy)).T) < 380]
    theirs = cv2.fisheye.undistortPoints(uv[:, None], FISHEYE.K, np.array(FISHEYE.distortion)).reshape(-1, 2)
    assert np.abs(rays_from_pixels(FISHEYE, uv) - theirs).max() < 1e-9


@pytest.mark.parametrize("camera", [EUROC, CHESS, RATIONAL], ids=["euroc", "chess", "rational"])
def test_every_pixel_of_a_real_lens_has_a_ray(camera: Camera) -> None:
    assert np.isfinite(rays_from_pixels(camera, pixels_of(camera))).all()


def test_beyond_the_fold_there_is_no_ray() -> None:
    radius_px = FOLDED.fx * FOLD_RADIUS * (1 - 0.4 * FOLD_RADIUS**2)  # 182.6 px, the largest the lens can reach
    uv = np.array([[320 + radius_px - 0.01, 240], [320 + radius_px + 0.01, 240], [0, 0]])
    x = rays_from_pixels(FOLDED, uv)
    assert x[0, 0] == pytest.approx(FOLD_RADIUS, abs=0.02)
    assert np.isnan(x[1:]).all()


def test_rays_beyond_the_fold_are_not_imaged() -> None:
    uv = pixels_from_rays(FOLDED, np.array([[FOLD_RADIUS - 1e-6, 0], [FOLD_RADIUS + 1e-6, 0], [1e200, 0]]))
    assert np.isfinite(uv[0]).all()
    assert np.isnan(uv[1:]).all()


def test_a_second_rising_branch_is_not_taken_for_the_lens() -> None:
    # 1 + 3 k1 s + 5 k2 s^2 has two roots: falls between them, rises again after
    camera = Camera(640, 480, 300, 300, 320, 240, "brown", (-0.5, 0.11))
    fold = np.sqrt(min(np.roots([5 * 0.11, 3 * -0.5, 1]).real))
    x = rays_from_pixels(camera, pixels_of(camera))
    assert np.nanmax(np.hypot(*x.T)) < fold
    assert np.isnan(rays_from_pixels(camera, np.array([[0.0, 0.0]]))).all()


def test_fisheye_pixels_behind_the_image_plane_have_no_ray() -> None:
    quarter_turn_px = IDEAL_FISHEYE.fx * np.pi / 2
    uv = np.array([[420 + quarter_turn_px - 2, 400], [420 + quarter_turn_px + 2, 400]])
    x = rays_from_pixels(IDEAL_FISHEYE, uv)
    assert x[0, 0] > 100
    assert np.isnan(x[1]).all()


def test_nan_pixels_stay_nan_and_harm_no_others() -> None:
    x = rays_from_pixels(EUROC, np.array([[np.nan, 1.0], [100.0, 100.0]]))
    assert np.isnan(x[0]).all()
    assert np.isfinite(x[1]).all()


@camera_cases
def test_pixels_are_laid_onto_a_plane_under_their_rays(camera: Camera) -> None:
    uv, normal = pixels_of(camera), np.array([0.0, -0.6, -0.8])
    points, met = points_on_plane(camera, uv, normal, 3.0)
    assert met.mean() > 0.3
    np.testing.assert_allclose(points[met] @ normal, -3.0, atol=1e-9)
    np.testing.assert_allclose(pixels_from_rays(camera, points[met, :2] / points[met, 2:]), uv[met], atol=1e-6)
    assert (points[met, 2] > 0).all()
    assert not points_on_plane(camera, uv, -normal, 3.0)[1][met].any()  # its back is not seen


def test_rays_along_a_plane_do_not_meet_it() -> None:
    """Ground under a level camera: met below the horizon, from 0.6 degrees on."""
    below = np.array([-5.0, 0.0, 0.5, 0.7, 5.0])
    uv = np.column_stack([np.full(5, PINHOLE.cx), PINHOLE.cy + PINHOLE.fy * np.tan(np.radians(below))])
    assert points_on_plane(PINHOLE, uv, np.array([0.0, -1.0, 0.0]), 1.0)[1].tolist() == [False] * 3 + [True] * 2


@camera_cases
def test_no_points_give_no_points(camera: Camera) -> None:
    assert rays_from_pixels(camera, np.empty((0, 2))).shape == (0, 2)
    assert pixels_from_rays(camera, np.empty((0, 2))).shape == (0, 2)


def test_too_many_coefficients_are_refused() -> None:
    camera = Camera(640, 480, 500, 500, 320, 240, "brown", (0.1,) * 12)
    with pytest.raises(InputError, match="8 coefficients, found 12"):
        rays_from_pixels(camera, np.zeros((1, 2)))


def test_a_resized_image_shows_the_same_rays() -> None:
    half = scale_camera(EUROC, 376, 240)
    uv = pixels_of(EUROC)
    in_half = (uv + 0.5) / 2 - 0.5
    assert np.abs(rays_from_pixels(half, in_half) - rays_from_pixels(EUROC, uv)).max() < 1e-12


def test_scale_camera_matches_cv2_resize() -> None:
    image = np.zeros((96, 128), np.float32)
    image[40:44, 60:64] = 1
    small = cv2.resize(image, (32, 24), interpolation=cv2.INTER_AREA)
    v, u = np.argwhere(small == 1)[0]
    camera = Camera(128, 96, 100, 100, 61.5, 41.5)  # principal point in the middle of the bright square
    scaled = scale_camera(camera, 32, 24)
    assert (scaled.cx, scaled.cy) == pytest.approx((u, v))


@pytest.mark.parametrize("camera", [EUROC, RATIONAL, PINHOLE], ids=["euroc", "rational", "pinhole"])
def test_maps_are_opencvs(camera: Camera) -> None:
    ours = undistortion_maps(camera)
    k = np.zeros(8)
    k[: len(camera.distortion)] = camera.distortion
    theirs = cv2.initUndistortRectifyMap(camera.K, k, None, camera.K, (camera.width, camera.height), cv2.CV_32FC1)
    for mine, their in zip(ours, theirs, strict=True):
        assert mine.dtype == np.float32
        assert np.abs(mine - their).max() < 1e-3  # float32


def test_maps_for_another_ideal_camera() -> None:
    ideal = Camera(200, 100, 150, 160, 90, 45)
    map_u, map_v = undistortion_maps(FISHEYE, ideal)
    uv = np.array([[0.0, 0.0], [199.0, 99.0], [37.0, 80.0]])
    wanted = pixels_from_rays(FISHEYE, rays_from_pixels(ideal, uv))
    found = np.array([(map_u[int(v), int(u)], map_v[int(v), int(u)]) for u, v in uv])
    assert map_u.shape == (100, 200)
    assert np.abs(found - wanted).max() < 1e-4


def test_what_the_lens_does_not_see_is_remapped_to_the_border_value() -> None:
    wide = Camera(400, 300, 100, 100, 199.5, 149.5)
    maps = undistortion_maps(FOLDED, wide)
    assert maps[0][0, 0] == OUTSIDE_PX
    image = np.full((480, 640), 200, np.uint8)
    ideal = cv2.remap(image, *maps, cv2.INTER_LINEAR)
    assert ideal[0, 0] == 0
    assert ideal[150, 200] == 200


def test_maps_need_an_ideal_camera() -> None:
    with pytest.raises(InputError, match="must be a pinhole"):
        undistortion_maps(EUROC, CHESS)


def test_pinhole_of_keeps_size_and_k() -> None:
    ideal = pinhole_of(EUROC)
    assert (ideal.model, ideal.distortion) == ("pinhole", ())
    assert (ideal.width, ideal.height) == (EUROC.width, EUROC.height)
    assert np.array_equal(ideal.K, EUROC.K)
