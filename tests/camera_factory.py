"""The same camera in every format of camera files, and what tests of camera files share."""

import json
from pathlib import Path

import numpy as np
import pytest

from slopecli.errors import InputError
from slopecli.io.cameras import load_camera
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
"""


ROS2_ECHO += ROS2_ECHO.replace("sec: 17", "sec: 18")  # the next message is of the same camera, later


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
    "colmap": (COLMAP_TEXT.replace("7 SIMPLE_RADIAL 640 480 500 320 240 0.1\n", ""), "COLMAP"),
    "metashape": (METASHAPE.replace("<cx>3</cx><cy>-2</cy>", ""), "Metashape"),
    "opensfm": (OPENSFM, "OpenSfM"),
    "nerfstudio": (NERFSTUDIO, "nerfstudio"),
}
