"""All formats of camera files: the same camera from each, and one line for damage of any kind."""

import json
import runpy
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
import yaml
from camera_factory import (
    AUTOWARE,
    BARE_MATRIX,
    BOUGUET,
    BROWN,
    CAMODOCAL,
    COLMAP_TEXT,
    EUROC_SENSOR,
    KALIBR,
    KITTI_ODOMETRY,
    MATRIX,
    METASHAPE,
    MIDDLEBURY,
    NATIVE,
    NERFSTUDIO,
    OPENCV_STEREO,
    OPENSFM,
    ORBSLAM,
    PDS3,
    PDS4,
    PIX4D,
    RECONSTRUCTION,
    ROS2_ECHO,
    ROS_FILE,
    SAMPLES,
    SPLATTING,
    K,
    check_is_the_sample,
    refusal,
    write,
)

from slopecli.errors import InputError
from slopecli.io.cameras import CAMERA_FORMATS, CameraFormat, camera_names, decode_camera, load_camera


@pytest.mark.parametrize(("content", "source"), SAMPLES.values(), ids=SAMPLES.keys())
def test_every_format_says_the_same_camera(tmp_path: Path, content: str | dict, source: str) -> None:
    camera = load_camera(write(tmp_path, content))
    check_is_the_sample(camera)
    assert camera.source == source


LENSLESS = {
    "OpenCV": {"camera_matrix": MATRIX},
    "ROS": {"camera_matrix": MATRIX, "distortion_model": "", "camera_name": "a"},
    "Kalibr": {"camera_model": "pinhole", "intrinsics": K},
    "nerfstudio": {"fl_x": 800, "w": 1024, "h": 768},
    "OpenSfM": {"cameras": {"a": {"projection_type": "brown", "focal": 0.8, "width": 1024, "height": 768}}},
    "native": NATIVE,
}


@pytest.mark.parametrize("key", ["coeffs", "distortion_params", "radial_distortion", "lens_coefficients"])
@pytest.mark.parametrize("tree", LENSLESS.values(), ids=LENSLESS)
def test_coefficients_under_another_name_never_count_as_none(tmp_path: Path, tree: dict, key: str) -> None:
    named = {"cameras": {"a": {**tree["cameras"]["a"], key: BROWN}}} if "cameras" in tree else {**tree, key: BROWN}
    (tmp_path / "plain.json").write_text(json.dumps(tree))
    load_camera(tmp_path / "plain.json", size=(1024, 768))
    (tmp_path / "camera.json").write_text(json.dumps(named))
    with pytest.raises(InputError, match=key):
        load_camera(tmp_path / "camera.json", size=(1024, 768))


@pytest.mark.parametrize("form", CAMERA_FORMATS, ids=lambda form: form.name)
def test_every_format_has_tests_of_its_own(form: CameraFormat) -> None:
    module = form.module.__name__.rpartition(".")[2]
    assert Path(__file__).with_name(f"test_camera_{module}.py").exists()


def test_the_table_of_formats_is_current() -> None:
    root = Path(__file__).resolve().parent.parent
    table = runpy.run_path(str(root / "docs" / "generate.py"))["camera_formats_table"]()
    assert table in (root / "docs" / "cameras.md").read_text(encoding="utf-8"), "run `make docs`"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ("  \n ", "is empty"),
        ("hello", "no camera that is understood"),
        ("[1, 2, 3]", "no camera that is understood"),
        ('{"fx": 800,', "damaged JSON"),
        ("a: [1, 2", "neither JSON nor YAML"),
        ("a: !!python/object/apply:os.system [ls]", "neither JSON nor YAML"),
        ('{"a":' * 20000, "JSON"),
        ("{}", "no camera that is understood"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "is binary"),
        (b"\xff\xfe\xfa" * 50, "neither text nor"),
    ],
)
def test_what_is_no_camera_file(tmp_path: Path, content: str | bytes, words: str) -> None:
    message = refusal(write(tmp_path, content))
    assert words in message
    assert len(message) < 500


def test_damage_never_ends_in_a_traceback(tmp_path: Path) -> None:
    texts = [s if isinstance(s, str) else json.dumps(s) for s, _ in SAMPLES.values()]
    texts += [KALIBR, COLMAP_TEXT, METASHAPE, OPENCV_STEREO]
    scraps = ["null", "[", "]", "{", "}", "-", "nan", "'x'", "0", ":", "1e999", "<a>", "\t", "\n", '"']
    rng = np.random.default_rng(5)
    refused = 0
    for text in texts:
        for _ in range(40):
            a, b = sorted(rng.integers(0, len(text), 2))
            damaged = text[:a] + scraps[rng.integers(len(scraps))] + text[a + (b - a) // 20 :]
            message = outcome(write(tmp_path, damaged))
            assert "\n" not in message
            refused += bool(message)
    assert refused > 230


def outcome(path: Path) -> str:
    """The refusal, "" when a camera came out."""
    try:
        load_camera(path, size=(1024, 768))
    except InputError as error:
        return str(error)
    return ""


def values_in(tree: object) -> list:
    if isinstance(tree, dict):
        return [(tree, key) for key in tree] + [place for value in tree.values() for place in values_in(value)]
    return []


def test_values_of_the_wrong_kind_never_end_in_a_traceback(tmp_path: Path) -> None:
    opencv = {"camera_matrix": MATRIX, "dist_coeffs": list(BROWN), "image_size": [1024, 768], "model": "brown"}
    texts = [json.dumps(tree) for tree in (NATIVE, OPENSFM, NERFSTUDIO, opencv)]
    for text in [*texts, ROS_FILE, ROS2_ECHO.split("---")[0], EUROC_SENSOR]:
        sound = yaml.safe_load(text)
        for i in range(len(values_in(sound))):
            for wrong in (None, 5, "x", [], [[1]], {}, {"a": 1}, True, -1, 1e400, [None]):
                tree = deepcopy(sound)
                holder, key = values_in(tree)[i]
                holder[key] = wrong
                assert "\n" not in outcome(write(tmp_path, json.dumps(tree)))


TEXTS = {
    "pix4d": PIX4D,
    "kitti": KITTI_ODOMETRY,
    "middlebury": MIDDLEBURY,
    "matrix": BARE_MATRIX,
    "bouguet": BOUGUET,
    "pds3": PDS3,
    "pds4": PDS4,
    "camodocal": CAMODOCAL,
    "orbslam": ORBSLAM,
    "autoware": AUTOWARE,
    "splatting": SPLATTING,
    "reconstruction": RECONSTRUCTION,
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_line_ends_and_marks_of_other_systems_change_nothing(tmp_path: Path, text: str) -> None:
    names = camera_names(text.encode(), "camera")
    for name in names:
        plain, changed = (
            decode_camera(data, "camera", name, (1024, 768))
            for data in (text.encode(), b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
        )
        assert changed == plain
