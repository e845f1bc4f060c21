"""OpenSfM cameras."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from camera_factory import OPENSFM, brown_image, check_pixels, directions, fisheye_image, refusal, write

from slopecli.io.cameras import load_camera


def test_opensfm_centre_and_simple_lenses(tmp_path: Path) -> None:
    tree = {"a": {"projection_type": "perspective", "width": 1000, "height": 500, "focal": 0.9, "k1": 0.1, "k2": 0.0}}
    camera = load_camera(write(tmp_path, tree))
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (900, 900, 499.5, 249.5)
    assert camera.distortion[:2] == (0.1, 0.0)
    brown = {**OPENSFM["v2 dji fc6310 1024 768 brown 0.78"], "c_x": 0.01, "c_y": -0.02}
    camera = load_camera(write(tmp_path, {"a": brown}))
    assert (camera.cx, camera.cy) == pytest.approx((511.5 + 10.24, 383.5 - 20.48))


@pytest.mark.parametrize(("width", "height"), [(1000, 500), (500, 1000)])
@pytest.mark.parametrize(
    ("kind", "keys", "image_of", "lens"),
    [
        ("perspective", {"focal": 0.9, "k1": -0.1, "k2": 0.02}, brown_image, (-0.1, 0.02)),
        ("simple_radial", {"focal_x": 0.9, "focal_y": 0.9, "k1": -0.1}, brown_image, (-0.1,)),
        ("radial", {"focal_x": 0.9, "focal_y": 0.9, "k1": -0.1, "k2": 0.02}, brown_image, (-0.1, 0.02)),
        ("fisheye", {"focal": 0.9, "k1": 0.01, "k2": -0.02}, fisheye_image, (0.01, -0.02)),
        (
            "fisheye_opencv",
            {"focal_x": 0.9, "focal_y": 0.9, "k1": 0.01, "k2": -0.02, "k3": 0.003, "k4": -0.001},
            fisheye_image,
            (0.01, -0.02, 0.003, -0.001),
        ),
    ],
)
def test_opensfm_pixels(
    tmp_path: Path, kind: str, keys: dict, image_of: Callable[..., tuple], lens: tuple, width: int, height: int
) -> None:
    """In units of the longer side from the middle: pixel = normalised * 1000 + (side - 1) / 2, portrait or not."""
    x = directions()
    across, down = image_of(x, *lens)
    off = {"c_x": 0.01, "c_y": -0.02} if "focal_x" in keys else {"c_x": 0.0, "c_y": 0.0}
    tree = {"a": {"projection_type": kind, "width": width, "height": height, **keys, **off}}
    u, v = 0.9 * across + off["c_x"], 0.9 * down + off["c_y"]
    check_pixels(load_camera(write(tmp_path, tree)), x, 1000 * u + (width - 1) / 2, 1000 * v + (height - 1) / 2)


@pytest.mark.parametrize("kind", ["fisheye62", "fisheye624", "dual"])
def test_other_lenses_of_opensfm_are_refused(tmp_path: Path, kind: str) -> None:
    tree = {"a": {"projection_type": kind, "width": 1000, "height": 500, "focal_x": 0.9, "focal_y": 0.9, "k1": 0.1}}
    assert f"'{kind}' is not supported" in refusal(write(tmp_path, tree))


def test_opensfm_spherical_is_refused(tmp_path: Path) -> None:
    tree = {"a": {"projection_type": "spherical", "width": 1000, "height": 500}}
    assert "'spherical' is not supported" in refusal(write(tmp_path, tree))


def test_reconstructions_of_opensfm(tmp_path: Path) -> None:
    """Each reconstruction adjusts its cameras for itself: the same name may stand for two."""
    name, brown = next(iter(OPENSFM.items()))
    brown = {**brown, "c_x": 0.01, "c_y": -0.02}
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0.0, 0.0002, 1e-5)
    path = write(tmp_path, json.dumps([{"cameras": {name: brown}, "shots": {}}, {"cameras": {name: brown}}]))
    # normalised by the longer side from the middle, and pixel = normalised * max(w, h) + (w - 1) / 2
    u, v = (800 / 1024 * across + 0.01) * 1024 + 511.5, (810 / 1024 * down - 0.02) * 1024 + 383.5
    check_pixels(load_camera(path), x, u, v)
    other = {**brown, "focal_x": 0.9}
    path = write(tmp_path, json.dumps([{"cameras": {name: brown}}, {"cameras": {name: other}}]))
    assert load_camera(f"{path}#2/{name}").fx == pytest.approx(0.9 * 1024)
    assert "holds 2 cameras" in refusal(path)
    corner = {**brown, "c_x": 0.5, "c_y": 0.375}
    assert "from the middle" in refusal(write(tmp_path, json.dumps([{"cameras": {name: corner}}])))
