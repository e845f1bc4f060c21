"""Camera files: every format in a small sample, every refusal by name, and nothing but one line for damage."""

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from slopecli.errors import InputError
from slopecli.io.cameras import MODELS, camera_from_fov, camera_from_intrinsics, fit_camera_to_image, load_camera
from slopecli.types import Camera

K = (800.0, 810.0, 511.5, 383.5)
MATRIX = [[800.0, 0.0, 511.5], [0.0, 810.0, 383.5], [0.0, 0.0, 1.0]]
BROWN = (-0.28, 0.074, 0.0002, 1e-05)

NATIVE = {
    "width": 1024,
    "height": 768,
    "fx": 800,
    "fy": 810,
    "cx": 511.5,
    "cy": 383.5,
    "distortion": [-0.28, 0.074, 0.0002, 1e-5],
}

OPENCV_YAML = """%YAML:1.0
---
calibration_time: "Tue Jan  1 10:00:00 2030"
image_width: 1024
image_height: 768
flags: 0
fisheye_model: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 800., 0., 511.5, 0., 810., 383.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.28, 7.4e-02, 2.0000000000000001e-04, 1e-05, 0. ]
avg_reprojection_error: 1.9e-01
"""

OPENCV_STEREO = """%YAML:1.0
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 800., 0., 511.5, 0., 810., 383.5, 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 4
   dt: d
   data: [ -0.28, 0.074, 0.0002, 1e-05 ]
M2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 900., 0., 500., 0., 900., 380., 0., 0., 1. ]
D2: !!opencv-matrix
   rows: 1
   cols: 4
   dt: d
   data: [ 0., 0., 0., 0. ]
P1: !!opencv-matrix { rows: 3, cols: 4, dt: d, data: [ 1., 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0 ] }
"""

ROS_FILE = """image_width: 1024
image_height: 768
camera_name: nadir
camera_matrix:
  rows: 3
  cols: 3
  data: [800, 0, 511.5, 0, 810, 383.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.28, 0.074, 0.0002, 1e-05, 0]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [790, 0, 500, 0, 0, 790, 380, 0, 0, 0, 1, 0]}
"""

ROS2_ECHO = """header:
  stamp: {sec: 17, nanosec: 5}
  frame_id: camera
height: 768
width: 1024
distortion_model: plumb_bob
d: [-0.28, 0.074, 0.0002, 1.0e-05, 0.0]
k: [800.0, 0.0, 511.5, 0.0, 810.0, 383.5, 0.0, 0.0, 1.0]
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [790.0, 0.0, 500.0, 0.0, 0.0, 790.0, 380.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}
---
height: 1
width: 1
---
"""
ROS1_ECHO = ROS2_ECHO.replace("\nd:", "\nD:").replace("\nk:", "\nK:").replace("\nr:", "\nR:").replace("\np:", "\nP:")

KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.074, 0.0002, 1e-05]
  distortion_model: radtan
  intrinsics: [800.0, 810.0, 511.5, 383.5]
  resolution: [1024, 768]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.0016, 0.024, -0.036, 0.02]
  distortion_model: equidistant
  intrinsics: [461.5, 460.1, 356.4, 231.2]
  resolution: [752, 480]
cam2:
  camera_model: omni
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [1.8, 461.5, 460.1, 356.4, 231.2]
  resolution: [752, 480]
"""

EUROC_SENSOR = """sensor_type: camera
comment: VI-Sensor cam0
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [1024, 768]
camera_model: pinhole
intrinsics: [800.0, 810.0, 511.5, 383.5] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.074, 0.0002, 1e-05]
"""

COLMAP_TEXT = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 2
1 OPENCV 1024 768 800 810 512 384 -0.28 0.074 0.0002 1e-05
7 SIMPLE_RADIAL 640 480 500 320 240 0.1
"""

OPENSFM = {
    "v2 dji fc6310 1024 768 brown 0.78": {
        "projection_type": "brown",
        "width": 1024,
        "height": 768,
        "focal_x": 800 / 1024,
        "focal_y": 810 / 1024,
        "c_x": 0.0,
        "c_y": 0.0,
        "k1": -0.28,
        "k2": 0.074,
        "p1": 0.0002,
        "p2": 1e-5,
        "k3": 0.0,
    }
}

NERFSTUDIO = {
    "camera_model": "OPENCV",
    "w": 1024,
    "h": 768,
    "fl_x": 800,
    "fl_y": 810,
    "cx": 512,
    "cy": 384,
    "k1": -0.28,
    "k2": 0.074,
    "p1": 0.0002,
    "p2": 1e-5,
    "frames": [{"file_path": "images/a.jpg", "transform_matrix": []}],
}

METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1"><sensors next_id="2">
<sensor id="0" label="M3M (12.29mm)" type="frame">
  <resolution width="1024" height="768"/>
  <calibration type="frame" class="initial"><resolution width="1024" height="768"/><f>700</f></calibration>
  <calibration type="frame" class="adjusted"><resolution width="1024" height="768"/>
    <f>810</f><b1>-10</b1><cx>3</cx><cy>-2</cy><k1>-0.28</k1><k2>0.074</k2><p1>1e-05</p1><p2>0.0002</p2>
  </calibration>
</sensor>
</sensors></chunk></document>
"""


def write(folder: Path, content: str | bytes | dict, name: str = "camera") -> Path:
    path = folder / name
    if isinstance(content, dict):
        content = json.dumps(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def refusal(path: Path | str, **kwargs: object) -> str:
    with pytest.raises(InputError) as caught:
        load_camera(path, **kwargs)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path).split("#")[0] in message
    return message


def check_is_the_sample(camera: Camera, cx: float = 511.5, cy: float = 383.5) -> None:
    assert (camera.width, camera.height, camera.model) == (1024, 768, "brown")
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((800, 810, cx, cy), abs=1e-9)
    coefficients = np.zeros(8)
    coefficients[: len(camera.distortion)] = camera.distortion
    assert coefficients == pytest.approx([*BROWN, 0, 0, 0, 0], abs=1e-15)


SAMPLES = {
    "native": (NATIVE, "native"),
    "opencv": (OPENCV_YAML, "OpenCV"),
    "ros-file": (ROS_FILE, "ROS camera_info"),
    "ros2-echo": (ROS2_ECHO, "ROS camera_info"),
    "ros1-echo": (ROS1_ECHO, "ROS camera_info"),
    "euroc": (EUROC_SENSOR, "Kalibr"),
    "opensfm": (OPENSFM, "OpenSfM"),
    "nerfstudio": (NERFSTUDIO, "nerfstudio"),
}


@pytest.mark.parametrize(("content", "source"), SAMPLES.values(), ids=SAMPLES.keys())
def test_every_format_says_the_same_camera(tmp_path: Path, content: str | dict, source: str) -> None:
    camera = load_camera(write(tmp_path, content))
    check_is_the_sample(camera)
    assert camera.source == source


# ---- native ----


def test_native_with_matrix_and_null_distortion(tmp_path: Path) -> None:
    for distortion in (None, [], [0, 0, 0, 0, 0]):
        tree = {"width": 1024, "height": 768, "K": MATRIX, "distortion": distortion}
        camera = load_camera(write(tmp_path, tree))
        assert camera == Camera(1024, 768, *K, source="native")


@pytest.mark.parametrize("count", range(1, 9))
def test_native_distortion_of_any_length_is_padded_with_zeros(tmp_path: Path, count: int) -> None:
    given = [0.01 * (i + 1) for i in range(count)]
    camera = load_camera(write(tmp_path, {**NATIVE, "distortion": given}))
    assert camera.distortion[:count] == tuple(given)
    assert not any(camera.distortion[count:])


def test_native_fisheye(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, {**NATIVE, "model": "fisheye", "distortion": [0.1, 0.2]}))
    assert (camera.model, camera.distortion) == ("fisheye", (0.1, 0.2, 0.0, 0.0))


def test_native_fisheye_without_coefficients_is_no_pinhole(tmp_path: Path) -> None:
    assert load_camera(write(tmp_path, {**NATIVE, "model": "fisheye", "distortion": None})).model == "fisheye"


def test_our_own_output_is_read_back(tmp_path: Path) -> None:
    tree = {**NATIVE, "model": "brown", "source": "OpenCV"}
    check_is_the_sample(load_camera(write(tmp_path, tree)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"distorsion": [0.1]}, "unknown key 'distorsion'"),
        ({"k1": 0.1}, "unknown key 'k1'"),
        ({"fx": 0}, "not calibrated"),
        ({"fy": -800}, "negative"),
        ({"fx": float("nan")}, "finite"),
        ({"fx": float("inf")}, "finite"),
        ({"fx": "eight"}, "needed a number"),
        ({"fx": True}, "needed a number"),
        ({"fx": 8.8}, "not in millimetres"),
        ({"cx": 1e6}, "far outside"),
        ({"width": 0}, "whole number"),
        ({"width": 10.5}, "whole number"),
        ({"width": None}, "width is None"),
        ({"distortion": [0.1] * 12}, "thin prism or tilt"),
        ({"distortion": [0.1] * 9}, "found 9 distortion coefficients"),
        ({"distortion": ["a"]}, "needed a number"),
        ({"distortion": [[0.1], [float("nan")]]}, "finite"),
        ({"model": "omni"}, "'omni' is not supported"),
        ({"model": "eucm"}, "'eucm' is not supported"),
        ({"model": "pinhole"}, "name the lens model"),
        ({"model": "fisheye", "distortion": [0.1] * 5}, "a fisheye lens takes 4"),
        ({"K": MATRIX}, "both K and"),
    ],
)
def test_native_refusals(tmp_path: Path, change: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, {**NATIVE, **change}))


def test_native_with_a_missing_number(tmp_path: Path) -> None:
    tree = {key: value for key, value in NATIVE.items() if key != "cy"}
    assert "cy is missing" in refusal(write(tmp_path, tree))


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[800, 0.5, 511.5], [0, 810, 383.5], [0, 0, 1]], "skew 0.5"),
        ([[800, 0, 0], [0, 810, 0], [511.5, 383.5, 1]], "transposed"),
        ([800, 810, 511.5, 383.5], "has 4 numbers"),
    ],
)
def test_matrices_that_are_no_intrinsics(tmp_path: Path, matrix: list, words: str) -> None:
    assert words in refusal(write(tmp_path, {"width": 1024, "height": 768, "K": matrix}))


# ---- OpenCV ----


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_what_opencv_writes_is_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"camera.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1024)
    storage.write("image_height", 768)
    storage.write("camera_matrix", np.array(MATRIX))
    storage.write("distortion_coefficients", np.array([*BROWN, 0.0]).reshape(5, 1))
    storage.release()
    check_is_the_sample(load_camera(path))


@pytest.mark.parametrize(
    ("matrix", "lens"),
    [
        ("camera_matrix", "distortion_coefficients"),
        ("cameraMatrix", "distCoeffs"),
        ("Camera_Matrix", "Distortion_Coefficients"),
        ("camera_matrix", "dist_coeff"),
        ("K", "D"),
        ("mtx", "dist"),
        ("intrinsic_matrix", "distortion_coeffs"),
    ],
)
def test_names_people_give_opencv_matrices(tmp_path: Path, matrix: str, lens: str) -> None:
    tree = {matrix: MATRIX, lens: [list(BROWN)], "image_size": [1024, 768], "rms": 0.2}
    check_is_the_sample(load_camera(write(tmp_path, tree)))


def test_opencv_without_size_takes_the_images(tmp_path: Path) -> None:
    path = write(tmp_path, {"camera_matrix": MATRIX, "dist_coeffs": list(BROWN)})
    check_is_the_sample(load_camera(path, size=(1024, 768)))
    assert "gives no image size" in refusal(path)


def test_a_matrix_alone_is_a_pinhole_and_says_so(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, {"camera_matrix": MATRIX}), size=(1024, 768))
    assert camera == Camera(1024, 768, *K, source="OpenCV, no distortion given")


def test_opencv_fisheye(tmp_path: Path) -> None:
    text = OPENCV_YAML.replace("fisheye_model: 0", "fisheye_model: 1").replace(", 0. ]\navg", " ]\navg")
    camera = load_camera(write(tmp_path, text.replace("rows: 5", "rows: 4")))
    assert (camera.model, camera.distortion) == ("fisheye", BROWN)


def test_opencv_stereo_file_needs_a_choice(tmp_path: Path) -> None:
    path = write(tmp_path, OPENCV_STEREO)
    assert "holds 2 cameras (1, 2); pick one, for example camera#1" in refusal(path, size=(1024, 768))
    check_is_the_sample(load_camera(f"{path}#1", size=(1024, 768)))
    assert load_camera(path, name="2", size=(1024, 768)) == Camera(1024, 768, 900, 900, 500, 380, source="OpenCV")
    assert "no camera '3'" in refusal(f"{path}#3", size=(1024, 768))


def test_rational_and_longer_coefficients(tmp_path: Path) -> None:
    tree = {"K": MATRIX, "D": [5.3, 3.2, 0.0, 0.0, 0.2, 5.6, 4.8, 0.9], "image_size": [1024, 768]}
    assert load_camera(write(tmp_path, tree)).distortion == tuple(tree["D"])
    assert load_camera(write(tmp_path, {**tree, "D": [*tree["D"], 0, 0, 0, 0, 0, 0]})).distortion == tuple(tree["D"])
    assert "thin prism" in refusal(write(tmp_path, {**tree, "D": [*tree["D"], 0.1, 0, 0, 0]}))


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ({"xi": 1.2}, "omnidirectional camera (xi)"),
        ({"distorsion": [0.1, 0, 0, 0]}, "'distorsion' is not understood"),
        ({"radial_distortion": [0.1, 0]}, "'radial_distortion' is not understood"),
        ({"k1": 0.1}, "'k1' stands alone"),
        ({"model": "double_sphere"}, "'double_sphere' is not supported"),
        ({"dist": [0.1, 0.2, 0.3]}, "found 3 distortion coefficients"),
        ({"dist": [0, 0, 0, 0], "D": [0, 0, 0, 0]}, "both 'dist' and 'D'"),
        ({"dist": {"rows": 1, "cols": 5, "data": [0, 0, 0, 0]}}, "has 4 numbers"),
        ({"image_size": [1024]}, "needed width and height"),
    ],
)
def test_opencv_refusals(tmp_path: Path, extra: dict, words: str) -> None:
    tree = {"camera_matrix": MATRIX, "image_width": 1024, "image_height": 768, **extra}
    assert words in refusal(write(tmp_path, tree))


def test_numpy_archive(tmp_path: Path) -> None:
    path = tmp_path / "calib.npz"
    np.savez(path, mtx=np.array(MATRIX), dist=np.array([BROWN]), rvecs=np.array([1, "a"], dtype=object))
    check_is_the_sample(load_camera(path, size=(1024, 768)))
    assert "damaged zip" in refusal(write(tmp_path, path.read_bytes()[:200], "cut.npz"))


# ---- ROS ----


OPENCV_ND = """<?xml version="1.0"?>
<opencv_storage>
<cameraMatrix type_id="opencv-matrix">
  <rows>3</rows><cols>3</cols><dt>d</dt><data>800. 0. 511.5 0. 810. 383.5 0. 0. 1.</data></cameraMatrix>
<distCoeffs type_id="opencv-nd-matrix">
  <sizes>
    5</sizes>
  <dt>d</dt><data>-0.28 7.4e-02 2.0e-04 1e-05 0.</data></distCoeffs>
</opencv_storage>
"""


def test_opencv_xml_with_coefficients_in_an_array_of_one_dimension(tmp_path: Path) -> None:
    (tmp_path / "nd.xml").write_text(OPENCV_ND)
    assert load_camera(tmp_path / "nd.xml", size=(1024, 768)).distortion == pytest.approx((*BROWN, 0))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("    5</sizes>", "    4</sizes>", "distCoeffs has 5 numbers, needed sizes = 4"),
        ("<data>-0.28 7.4e-02 2.0e-04 1e-05 0.</data>", "", "distCoeffs holds sizes, dt"),
        ("distCoeffs", "coeffs", "'coeffs' is not understood"),
        ("distCoeffs", "distCoeffs2", "'distCoeffs2' belongs to no matrix"),
    ],
)
def test_opencv_coefficients_not_understood_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    (tmp_path / "nd.xml").write_text(OPENCV_ND.replace(old, new))
    with pytest.raises(InputError, match=words):
        load_camera(tmp_path / "nd.xml", size=(1024, 768))


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


def test_opencv_coefficients_as_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text(json.dumps({"camera_matrix": MATRIX, "distCoeffs": "-0.28 0.07 0 0"}))
    with pytest.raises(InputError, match=r"distCoeffs is .* needed a number"):
        load_camera(tmp_path / "camera.json", size=(1024, 768))


def test_pickled_coefficients_of_a_numpy_archive_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "camera.npz", mtx=np.array(MATRIX), dist=np.array([None, 0.1], dtype=object))
    with pytest.raises(InputError, match="dist is 'a pickled object'"):
        load_camera(tmp_path / "camera.npz", size=(1024, 768))


def test_ros_models(tmp_path: Path) -> None:
    rational = ROS2_ECHO.replace("plumb_bob", "rational_polynomial").replace(
        "d: [-0.28, 0.074, 0.0002, 1.0e-05, 0.0]", "d: [5.3, 3.2, 0.0003, -0.0002, 0.2, 5.6, 4.8, 0.9]"
    )
    assert len(load_camera(write(tmp_path, rational)).distortion) == 8
    fisheye = ROS2_ECHO.replace("plumb_bob", "equidistant").replace(", 1.0e-05, 0.0]", ", 1.0e-05]")
    assert load_camera(write(tmp_path, fisheye)).model == "fisheye"
    undistorted = ROS2_ECHO.replace("plumb_bob", "''").replace("[-0.28, 0.074, 0.0002, 1.0e-05, 0.0]", "[]")
    assert load_camera(write(tmp_path, undistorted)).model == "pinhole"


def test_ros_unknown_model_is_refused_by_name(tmp_path: Path) -> None:
    assert "'thin_prism' is not supported" in refusal(write(tmp_path, ROS_FILE.replace("plumb_bob", "thin_prism")))


def test_ros_model_without_its_coefficients_is_refused(tmp_path: Path) -> None:
    assert "is missing" in refusal(write(tmp_path, ROS2_ECHO.replace("\nd:", "\nsomething:")))


def test_ros_camera_name_picks(tmp_path: Path) -> None:
    path = write(tmp_path, ROS_FILE)
    check_is_the_sample(load_camera(f"{path}#nadir"))
    assert "no camera 'left'; it holds nadir" in refusal(f"{path}#left")


def test_ros_binning_and_region_of_interest(tmp_path: Path) -> None:
    text = ROS2_ECHO.replace("binning_x: 0", "binning_x: 2").replace("binning_y: 0", "binning_y: 2")
    text = text.replace(
        "{x_offset: 0, y_offset: 0, height: 0, width: 0", "{x_offset: 112, y_offset: 84, height: 600, width: 800"
    )
    camera = load_camera(write(tmp_path, text))
    assert (camera.width, camera.height) == (400, 300)
    # the principal point is the middle of the sensor and of the region alike
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((400, 405, 199.5, 149.5))


def test_uncalibrated_ros_camera(tmp_path: Path) -> None:
    text = ROS2_ECHO.replace("[800.0, 0.0, 511.5, 0.0, 810.0, 383.5, 0.0, 0.0, 1.0]", "[0, 0, 0, 0, 0, 0, 0, 0, 1]")
    assert "not calibrated" in refusal(write(tmp_path, text))


# ---- Kalibr ----


def test_kalibr_camchain(tmp_path: Path) -> None:
    path = write(tmp_path, KALIBR)
    check_is_the_sample(load_camera(f"{path}#cam0"))
    fisheye = load_camera(path, name="cam1")
    assert fisheye == Camera(
        752, 480, 461.5, 460.1, 356.4, 231.2, "fisheye", (-0.0016, 0.024, -0.036, 0.02), source="Kalibr"
    )
    assert "camera_model 'omni' is not supported" in refusal(f"{path}#cam2")
    assert "holds 3 cameras (cam0, cam1, cam2)" in refusal(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("radial-tangential", "fov", "'fov' is not supported"),
        ("camera_model: pinhole", "camera_model: eucm", "'eucm' is not supported"),
        ("camera_model: pinhole", "camera_model: ds", "'ds' is not supported"),
        ("[800.0, 810.0, 511.5, 383.5]", "[800.0, 810.0, 511.5]", "intrinsics has 3 numbers"),
        ("[1024, 768]", "[1024]", "resolution has 1 numbers"),
        ("distortion_coefficients", "something_else", "distortion_coeffs are missing"),
        ("1e-05", ".nan", "finite"),
    ],
)
def test_kalibr_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in refusal(write(tmp_path, EUROC_SENSOR.replace(old, new)))


def test_a_yaml_directive_before_a_camchain_is_skipped(tmp_path: Path) -> None:
    check_is_the_sample(load_camera(f"{write(tmp_path, '%YAML:1.0' + chr(10) + KALIBR)}#cam0"))


# ---- COLMAP ----


def test_colmap_text(tmp_path: Path) -> None:
    path = write(tmp_path, COLMAP_TEXT)
    camera = load_camera(f"{path}#1")
    check_is_the_sample(camera)
    assert camera.source == "COLMAP"
    other = load_camera(path, name="7")
    assert other == Camera(640, 480, 500, 500, 319.5, 239.5, "brown", (0.1,) + (0.0,) * 7, source="COLMAP")
    assert "holds 2 cameras (1, 7)" in refusal(path)


def test_colmap_binary(tmp_path: Path) -> None:
    first = struct.pack("<IiQQ8d", 1, 4, 1024, 768, 800, 810, 512, 384, *BROWN)
    second = struct.pack("<IiQQ3d", 2, 0, 640, 480, 500, 320, 240)
    path = write(tmp_path, struct.pack("<Q", 2) + first + second, "cameras.bin")
    check_is_the_sample(load_camera(f"{path}#1"))
    assert load_camera(f"{path}#2") == Camera(640, 480, 500, 500, 319.5, 239.5, source="COLMAP")
    assert "binary" in refusal(write(tmp_path, path.read_bytes()[:-4], "cut.bin"))


def test_half_a_pixel_between_colmap_and_us(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, "1 SIMPLE_PINHOLE 4 2 10 2 1\n"))
    assert (camera.cx, camera.cy) == (1.5, 0.5)  # the middle of a 4x2 image with pixel centres at integers


@pytest.mark.parametrize(
    ("line", "model", "distortion"),
    [
        ("1 PINHOLE 640 480 500 510 320 240", "pinhole", ()),
        ("1 RADIAL 640 480 500 320 240 0.1 0.2", "brown", (0.1, 0.2, 0, 0, 0, 0, 0, 0)),
        ("1 FULL_OPENCV 640 480 500 510 320 240 1 2 3 4 5 6 7 8", "brown", (1, 2, 3, 4, 5, 6, 7, 8)),
        ("1 OPENCV_FISHEYE 640 480 500 510 320 240 1 2 3 4", "fisheye", (1, 2, 3, 4)),
        ("1 SIMPLE_RADIAL_FISHEYE 640 480 500 320 240 0.1", "fisheye", (0.1, 0, 0, 0)),
        ("1 RADIAL_FISHEYE 640 480 500 320 240 0.1 0.2", "fisheye", (0.1, 0.2, 0, 0)),
    ],
)
def test_colmap_models(tmp_path: Path, line: str, model: str, distortion: tuple) -> None:
    camera = load_camera(write(tmp_path, line + "\n"))
    assert (camera.model, camera.distortion) == (model, distortion)
    assert (camera.fx, camera.cx, camera.cy) == (500, 319.5, 239.5)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1 FOV 640 480 500 510 320 240 0.9", "COLMAP model FOV is not supported"),
        ("1 THIN_PRISM_FISHEYE 640 480 1 2 3 4 5 6 7 8 9 10 11 12", "THIN_PRISM_FISHEYE is not supported"),
        ("1 BRAND_NEW 640 480 1 2 3", "COLMAP model BRAND_NEW is not supported"),
        ("1 PINHOLE 640 480 500 320 240", "has 3 parameters, needed 4"),
        ("1 PINHOLE 640 480 500 510 320 nan", "finite"),
    ],
)
def test_colmap_refusals(tmp_path: Path, line: str, words: str) -> None:
    assert words in refusal(write(tmp_path, line + "\n"))


# ---- OpenSfM, nerfstudio, Metashape ----


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


def test_nerfstudio_fisheye_and_per_frame_cameras(tmp_path: Path) -> None:
    fisheye = {**NERFSTUDIO, "camera_model": "OPENCV_FISHEYE", "k3": 0.1, "k4": 0.2, "p1": 0, "p2": 0}
    assert load_camera(write(tmp_path, fisheye)).distortion == (-0.28, 0.074, 0.1, 0.2)
    shared = {key: value for key, value in NERFSTUDIO.items() if key not in ("fl_x", "frames")}
    frames = [{"file_path": f"images/{name}.jpg", "fl_x": focal} for name, focal in (("a", 800), ("b", 900))]
    path = write(tmp_path, {**shared, "frames": frames})
    check_is_the_sample(load_camera(f"{path}#a.jpg"))
    assert load_camera(f"{path}#b.jpg").fx == 900


def test_nerfstudio_terms_we_lack_are_refused(tmp_path: Path) -> None:
    assert "k4 = 0.1" in refusal(write(tmp_path, {**NERFSTUDIO, "k4": 0.1}))
    assert "'EQUIRECTANGULAR'" in refusal(write(tmp_path, {**NERFSTUDIO, "camera_model": "EQUIRECTANGULAR"}))


def test_metashape_project(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, METASHAPE))
    check_is_the_sample(camera, cx=514.5, cy=381.5)
    assert camera.source == "Metashape"
    check_is_the_sample(load_camera(f"{write(tmp_path, METASHAPE)}#M3M (12.29mm)"), cx=514.5, cy=381.5)


def test_metashape_exported_calibrations(tmp_path: Path) -> None:
    new = (
        "<calibration><projection>frame</projection><width>1000</width><height>500</height>"
        "<f>900</f><cx>3</cx></calibration>"
    )
    camera = load_camera(write(tmp_path, new))
    assert camera == Camera(1000, 500, 900, 900, 502.5, 249.5, source="Metashape")
    old = (
        "<calibration><projection>frame</projection><width>1000</width><height>500</height>"
        "<fx>900</fx><fy>901</fy><cx>503</cx><cy>250</cy><skew>0</skew></calibration>"
    )
    camera = load_camera(write(tmp_path, old))
    assert camera == Camera(1000, 500, 900, 901, 502.5, 249.5, source="Metashape")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<k1>", "<k4>0.1</k4><k1>", "k4 = 0.1 (radial distortion of order 8) is not supported"),
        ("<k1>", "<b2>0.3</b2><k1>", "b2 = 0.3 (skew) is not supported"),
        ('type="frame" class="adjusted"', 'type="fisheye" class="adjusted"', "camera type 'fisheye'"),
        ("</document>", "", "damaged XML"),
        ("calibration", "nothing", "XML without a camera"),
    ],
)
def test_metashape_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in refusal(write(tmp_path, METASHAPE.replace(old, new)))


# ---- the page for users ----


def test_the_documented_native_file_is_read(tmp_path: Path) -> None:
    page = (Path(__file__).parents[1] / "docs" / "cameras.md").read_text(encoding="utf-8")
    camera = load_camera(write(tmp_path, page.split("```json")[1].split("```")[0]))
    assert camera == Camera(1024, 768, 800, 800, 511.5, 383.5, "brown", (-0.28, 0.07, 0.0002, 1e-5, 0), "native")


def test_every_format_and_colmap_model_is_documented() -> None:
    page = (Path(__file__).parents[1] / "docs" / "cameras.md").read_text(encoding="utf-8")
    words = [source for _, source in SAMPLES.values()] + [name for name, p in MODELS.items() if isinstance(p, str)]
    assert [word for word in words if word.lower() not in page.lower()] == []


# ---- anything else ----


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


def test_paths_that_cannot_be_read(tmp_path: Path) -> None:
    assert "no such camera file" in refusal(tmp_path / "none.json")
    assert "no such camera file" in refusal(f"{tmp_path / 'none.json'}#cam0")
    assert "is a folder" in refusal(tmp_path)
    assert "not a regular file" in refusal("/dev/zero")
    assert "cannot be read" in refusal(tmp_path / ("x" * 5000))


def test_a_hash_in_a_file_name_is_no_choice(tmp_path: Path) -> None:
    check_is_the_sample(load_camera(write(tmp_path, NATIVE, "rig#2.json")))


def test_a_name_for_a_nameless_camera(tmp_path: Path) -> None:
    assert "without a name; leave the name out" in refusal(f"{write(tmp_path, NATIVE)}#cam0")


def test_damage_never_ends_in_a_traceback(tmp_path: Path) -> None:
    texts = [s if isinstance(s, str) else json.dumps(s) for s, _ in SAMPLES.values()]
    texts += [KALIBR, COLMAP_TEXT, METASHAPE, OPENCV_STEREO]
    scraps = ["null", "[", "]", "{", "}", "-", "nan", "'x'", "0", ":", "1e999", "<a>", "\t", "\n", '"']
    rng = np.random.default_rng(5)
    refused = 0
    for text in texts:
        for _ in range(60):
            a, b = sorted(rng.integers(0, len(text), 2))
            damaged = text[:a] + scraps[rng.integers(len(scraps))] + text[a + (b - a) // 20 :]
            message = outcome(write(tmp_path, damaged))
            assert "\n" not in message
            refused += bool(message)
    assert refused > 300


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
        for i in range(len(values_in(yaml.safe_load(text)))):
            for wrong in (None, 5, "x", [], [[1]], {}, {"a": 1}, True, -1, 1e400, [None]):
                tree = yaml.safe_load(text)
                holder, key = values_in(tree)[i]
                holder[key] = wrong
                assert "\n" not in outcome(write(tmp_path, json.dumps(tree)))


# ---- from numbers, and to the image at hand ----


def test_from_intrinsics() -> None:
    assert camera_from_intrinsics(K, 1024, 768) == Camera(1024, 768, *K)
    with pytest.raises(InputError, match="negative"):
        camera_from_intrinsics((-1, 1, 1, 1), 1024, 768)


@pytest.mark.parametrize(("which", "extent"), [("h", 1024), ("v", 768), ("d", 1280)])
def test_from_field_of_view(which: str, extent: float) -> None:
    camera = camera_from_fov(90, 1024, 768, which)
    assert camera.fx == camera.fy == pytest.approx(extent / 2)
    assert (camera.cx, camera.cy) == (511.5, 383.5)
    assert camera.source == "field of view"


@pytest.mark.parametrize("deg", [0, -5, 180, 400, float("nan")])
def test_impossible_field_of_view(deg: float) -> None:
    with pytest.raises(InputError, match="field of view"):
        camera_from_fov(deg, 1024, 768)


def test_the_same_size_is_left_alone() -> None:
    camera = Camera(1024, 768, *K)
    assert fit_camera_to_image(camera, 1024, 768) == (camera, None)


@pytest.mark.parametrize(("width", "height"), [(512, 384), (2048, 1536), (683, 512), (300, 225), (1000, 750)])
def test_a_resized_image_scales_the_camera(width: int, height: int) -> None:
    camera, message = fit_camera_to_image(Camera(1024, 768, *K), width, height)
    assert (camera.width, camera.height) == (width, height)
    assert (camera.cx, camera.cy) == pytest.approx(((width - 1) / 2, (height - 1) / 2))
    assert camera.fx == pytest.approx(800 * width / 1024)
    assert message is not None
    assert f"{width}x{height}" in message
    assert "1024x768" in message


@pytest.mark.parametrize(("width", "height"), [(1024, 767), (1024, 700), (1000, 768), (640, 640), (1920, 1080)])
def test_a_cropped_image_is_refused(width: int, height: int) -> None:
    with pytest.raises(InputError, match=rf"1024x768 px.*{width}x{height} px"):
        fit_camera_to_image(Camera(1024, 768, *K), width, height)


@pytest.mark.parametrize(("width", "height"), [(768, 1024), (384, 512)])
def test_a_turned_image_is_refused_with_a_hint(width: int, height: int) -> None:
    with pytest.raises(InputError, match="EXIF orientation"):
        fit_camera_to_image(Camera(1024, 768, *K), width, height)
