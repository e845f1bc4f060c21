"""OpenSfM cameras."""

import json
from pathlib import Path

import pytest
from camera_factory import OPENSFM, brown_image, check_pixels, directions, refusal, write

from slopecli.io.cameras import load_camera


def test_opensfm_centre_and_simple_lenses(tmp_path: Path) -> None:
    tree = {"a": {"projection_type": "perspective", "width": 1000, "height": 500, "focal": 0.9, "k1": 0.1, "k2": 0.0}}
    camera = load_camera(write(tmp_path, tree))
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (900, 900, 499.5, 249.5)
    assert camera.distortion[:2] == (0.1, 0.0)
    brown = {**OPENSFM["v2 dji fc6310 1024 768 brown 0.78"], "c_x": 0.01, "c_y": -0.02}
    camera = load_camera(write(tmp_path, {"a": brown}))
    assert (camera.cx, camera.cy) == pytest.approx((511.5 + 10.24, 383.5 - 20.48))


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
