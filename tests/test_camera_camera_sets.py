"""Cameras under names of their own."""

from pathlib import Path

import pytest
import yaml
from camera_factory import (
    NAMED,
    OPENCV_YAML,
    REALSENSE,
    ROS2_ECHO,
    ROS_FILE,
    brown_image,
    check_is_the_sample,
    check_pixels,
    directions,
    refusal,
    write,
)

from slopecli.io.cameras import load_camera

CAM = NAMED["cam0"]
INFO = yaml.safe_load(ROS_FILE)
ECHO = yaml.safe_load(ROS2_ECHO.split("---")[0])
OPENCV = yaml.safe_load(OPENCV_YAML.replace("!!opencv-matrix", "").partition("---")[2])

TREES = {
    "K-D": {"cam0": CAM, "cam1": {**CAM, "K": [[900, 0, 511.5], [0, 900, 383.5], [0, 0, 1]]}},
    "camera_info": {
        "/front/camera_info": INFO,
        "/rear/camera_info": {**INFO, "image_width": 2048, "image_height": 1536},
    },
    "messages": {"left": ECHO, "right": {**ECHO, "k": [900.0, 0, 511.5, 0, 900, 383.5, 0, 0, 1]}},
    "below": {"cameras": {"nadir": CAM, "oblique": {**CAM, "D": [0, 0, 0, 0, 0]}}},
    "opencv": {"left": OPENCV, "right": {**OPENCV, "image_width": 2048, "image_height": 1536}},
    "shared-size": {
        "image_width": 1024,
        "image_height": 768,
        "a": {"K": CAM["K"], "D": CAM["D"]},
        "b": {"K": CAM["K"], "D": [0] * 5},
    },
    "list": {"cameras": [{"name": "nadir", **CAM}, {"name": "oblique", **CAM, "D": [0, 0, 0, 0, 0]}]},
    "streams": {"color": REALSENSE, "depth": {**REALSENSE, "coeffs": [0] * 5}},
}


@pytest.mark.parametrize("tree", TREES.values(), ids=TREES)
def test_each_name_is_a_camera(tmp_path: Path, tree: dict) -> None:
    path = write(tmp_path, tree)
    names = list(tree.get("cameras") or [name for name in tree if not name.startswith("image_")])
    names = [name["name"] if isinstance(name, dict) else name for name in names]
    check_is_the_sample(load_camera(f"{path}#{names[0]}"))
    assert "holds 2 cameras" in refusal(path)
    second = load_camera(f"{path}#{names[1]}")
    assert second != load_camera(f"{path}#{names[0]}")


def test_named_pixels(tmp_path: Path) -> None:
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0.0, 0.0002, 1e-5)
    check_pixels(load_camera(write(tmp_path, NAMED)), x, 800 * across + 511.5, 810 * down + 383.5)


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ({"cam0": {"K": CAM["K"], "image_size": [1024, 768]}}, "comes without coefficients"),
        ({"cam0": {**CAM, "D": [0.1] * 4, "model": "omni"}}, "'omni' is not supported"),
        ({"cam0": CAM, "D": [0.1] * 4}, "'D' stands beside the named cameras"),
        ({"cam0": CAM, "distortion": [0.1] * 4}, "'distortion' is not understood"),
        ({"cam0": {**CAM, "K": [[800, 0, 0], [0, 800, 0], [511, 383, 1]]}}, "transposed"),
        ({"cam0": {"K": CAM["K"], "coefficients": [0.1] * 4}}, "coefficients"),
    ],
)
def test_named_refusals(tmp_path: Path, tree: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, tree))
