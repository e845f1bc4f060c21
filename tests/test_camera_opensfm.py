"""OpenSfM cameras."""

from pathlib import Path

import pytest
from camera_factory import OPENSFM, refusal, write

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
