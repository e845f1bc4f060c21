"""OpenMVG cameras."""

from copy import deepcopy
from pathlib import Path

import pytest
from camera_factory import OPENMVG, brown_image, check_pixels, directions, fisheye_image, refusal, write

from slopecli.io.cameras import load_camera

FLAT = {"width": 1024, "height": 768, "focal_length": 800.0, "principal_point": [511.5, 383.5]}


def one(kind: str, data: dict) -> dict:
    return {"intrinsics": [{"key": 0, "value": {"polymorphic_name": kind, "ptr_wrapper": {"data": data}}}]}


@pytest.mark.parametrize(
    ("tree", "lens"),
    [
        (OPENMVG, (-0.28, 0.074, 0.0, 0.0002, 1e-5)),
        (one("pinhole_radial_k3", {**FLAT, "disto_k3": [-0.28, 0.074, 0.001]}), (-0.28, 0.074, 0.001, 0, 0)),
        (one("pinhole_radial_k1", {**FLAT, "disto_k1": [-0.1]}), (-0.1, 0, 0, 0, 0)),
        (one("pinhole", FLAT), (0, 0, 0, 0, 0)),
    ],
    ids=["brown", "radial3", "radial1", "pinhole"],
)
def test_openmvg_pixels(tmp_path: Path, tree: dict, lens: tuple[float, ...]) -> None:
    x = directions()
    across, down = brown_image(x, *lens)
    check_pixels(load_camera(write(tmp_path, tree)), x, 800 * across + 511.5, 800 * down + 383.5)


def test_openmvg_fisheye(tmp_path: Path) -> None:
    x = directions()
    across, down = fisheye_image(x, 0.01, -0.02, 0.003, 0.0)
    camera = load_camera(write(tmp_path, one("fisheye", {**FLAT, "fisheye": [0.01, -0.02, 0.003, 0.0]})))
    check_pixels(camera, x, 800 * across + 511.5, 800 * down + 383.5)


def test_the_second_camera_of_a_kind_has_only_its_number(tmp_path: Path) -> None:
    tree = deepcopy(OPENMVG)
    second = deepcopy(tree["intrinsics"][0])
    second["key"] = 1
    second["value"] = {"polymorphic_id": 1, "ptr_wrapper": second["value"]["ptr_wrapper"]}
    second["value"]["ptr_wrapper"]["data"]["value0"]["focal_length"] = 900.0
    tree["intrinsics"].append(second)
    camera = load_camera(f"{write(tmp_path, tree)}#1")
    assert (camera.fx, camera.model) == (900, "brown")


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        (one("spherical", {"width": 1024, "height": 512}), "'spherical' is not supported"),
        (one("pinhole_radial_k3", {**FLAT, "disto_t2": [0.1] * 5}), "'disto_t2' is not understood"),
        (one("pinhole_radial_k3", {**FLAT, "disto_k3": [0.1]}), "1 coefficients"),
        (one("pinhole", {**FLAT, "disto_k1": [0.1]}), "'disto_k1' is not understood"),
        (one("pinhole", {**FLAT, "focal_length": -1}), "negative"),
        (one("pinhole", {**FLAT, "principal_point": [1]}), "principal_point has 1 numbers"),
    ],
)
def test_openmvg_refusals(tmp_path: Path, tree: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, tree))
