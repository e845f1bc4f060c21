"""The same camera in every format of camera files, and what tests of camera files share."""

import json
from pathlib import Path

import numpy as np
import pytest

from slopecli.errors import InputError
from slopecli.geometry import pixels_from_rays, rays_from_pixels
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


PIX4D = """Pix4D camera calibration file 0
#Focal Length mm assuming a sensor width of 12.8x9.6mm
F 10.0
#Principal Point mm
Px 6.4
Py 4.8
#Symmetrical Lens Distortion Coeffs
K1 -0.28
K2 0.074
K3 0.0
#Tangential Lens Distortion Coeffs
T1 0.0002
T2 0.00001
"""


def kitti(**lines: str) -> str:
    """KITTI's lines of numbers, in its notation."""
    numbers = {name: " ".join(f"{float(word):.6e}" for word in words.split()) for name, words in lines.items()}
    return "".join(f"{name}: {words}\n" for name, words in numbers.items())


KITTI_ODOMETRY = kitti(
    P0="718.856 0 607.1928 0 0 718.856 185.2157 0 0 0 1 0",
    P2="718.856 0 607.1928 45.38225 0 718.856 185.2157 -0.1130887 0 0 1 0.003779761",
    Tr="0.0004276 -0.99997 -0.0080845 -0.011985 -0.0072106 0.0080812 -0.99994 -0.05404 0.99997 0.00048595 0 0",
)


KITTI_RAW = "calib_time: 09-Jan-2012 13:57:47\n" + kitti(
    corner_dist="0.0995",
    S_00="1024 768",
    K_00="800 0 511.5 0 810 383.5 0 0 1",
    D_00="-0.28 0.074 0.0002 0.00001 0",
    R_00="1 0 0 0 1 0 0 0 1",
    T_00="0 0 0",
    S_rect_00="1000 700",
    R_rect_00="1 0 0 0 1 0 0 0 1",
    P_rect_00="720 0 490 0 0 720 340 0 0 0 1 0",
)


MIDDLEBURY = """cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]
cam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]
doffs=131.111
baseline=193.001
width=2964
height=1988
ndisp=280
isint=0
vmin=31
vmax=257
"""


BARE_MATRIX = "800.0 0.0 511.5\n0.0 810.0 383.5\n0.0 0.0 1.0\n"


CAMODOCAL = """%YAML:1.0
---
model_type: PINHOLE
camera_name: camera
image_width: 1024
image_height: 768
distortion_parameters:
   k1: -2.8e-01
   k2: 7.4e-02
   p1: 2.0e-04
   p2: 1e-05
projection_parameters:
   fx: 800.
   fy: 810.
   cx: 511.5
   cy: 383.5
"""


KANNALA_BRANDT = """%YAML:1.0
---
model_type: KANNALA_BRANDT
camera_name: cam0
image_width: 848
image_height: 800
projection_parameters:
   k2: -0.0076
   k3: 0.0425
   k4: -0.0404
   k5: 0.0075
   mu: 286.1
   mv: 286.3
   u0: 420.4
   v0: 401.9
"""


ORBSLAM = """%YAML:1.0
#--------------------------------------------------------------------------------------------
File.version: "1.0"
Camera.type: "PinHole"
Camera.fx: 800.0
Camera.fy: 810.0
Camera.cx: 511.5
Camera.cy: 383.5
Camera.k1: -0.28
Camera.k2: 0.074
Camera.p1: 0.0002
Camera.p2: 1.0e-05
Camera.width: 1024
Camera.height: 768
Camera.fps: 20
Camera.RGB: 1
ORBextractor.nFeatures: 1200
ORBextractor.scaleFactor: 1.2
"""


ORBSLAM_STEREO = """%YAML:1.0
File.version: "1.0"
Camera.type: "KannalaBrandt8"
Camera1.fx: 190.97
Camera1.fy: 190.98
Camera1.cx: 254.93
Camera1.cy: 256.89
Camera1.k1: 0.0034
Camera1.k2: 0.0007
Camera1.k3: -0.0020
Camera1.k4: 0.0002
Camera2.fx: 190.44
Camera2.fy: 190.43
Camera2.cx: 252.59
Camera2.cy: 254.91
Camera2.k1: 0.0040
Camera2.k2: 0.0001
Camera2.k3: -0.0018
Camera2.k4: 0.0003
Camera.width: 512
Camera.height: 512
Camera.bFishEye: 1
"""


AUTOWARE = """%YAML:1.0
---
CameraExtrinsicMat: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: [ 0., 0., 1., 0., -1., 0., 0., 0., 0., -1., 0., 0., 0., 0., 0., 1. ]
CameraMat: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 800., 0., 511.5, 0., 810., 383.5, 0., 0., 1. ]
DistCoeff: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.28, 0.074, 0.0002, 1e-05, 0. ]
ImageSize: [ 1024, 768 ]
ReprojectionError: 0.
DistModel: plumb_bob
"""


ALICEVISION = {
    "version": ["1", "2", "8"],
    "views": [{"viewId": "1", "poseId": "1", "intrinsicId": "7", "path": "a.jpg", "width": "1024", "height": "768"}],
    "intrinsics": [
        {
            "intrinsicId": "7",
            "width": "1024",
            "height": "768",
            "sensorWidth": "12.8",
            "sensorHeight": "9.6",
            "serialNumber": "x",
            "type": "pinhole",
            "initializationMode": "estimated",
            "initialFocalLength": "10",
            "focalLength": "10",
            "pixelRatio": "1.0125",
            "pixelRatioLocked": "true",
            "principalPoint": ["-0.5", "-0.5"],
            "distortionInitializationMode": "none",
            "distortionType": "brown",
            "distortionParams": ["-0.28", "0.074", "0", "0.0002", "0.00001"],
            "undistortionOffset": ["0", "0"],
            "undistortionParams": "",
            "locked": "false",
        }
    ],
}


OPENMVG = {
    "sfm_data_version": "0.3",
    "root_path": "images",
    "views": [],
    "intrinsics": [
        {
            "key": 0,
            "value": {
                "polymorphic_id": 2147483649,
                "polymorphic_name": "pinhole_brown_t2",
                "ptr_wrapper": {
                    "id": 2147483660,
                    "data": {
                        "value0": {
                            "width": 1024,
                            "height": 768,
                            "focal_length": 800.0,
                            "principal_point": [511.5, 383.5],
                        },
                        "disto_t2": [-0.28, 0.074, 0.0, 0.0002, 1e-05],
                    },
                },
            },
        }
    ],
    "extrinsics": [],
}


REALSENSE = {
    "width": 1024,
    "height": 768,
    "ppx": 511.5,
    "ppy": 383.5,
    "fx": 800,
    "fy": 810,
    "model": "distortion.brown_conrady",
    "coeffs": [-0.28, 0.074, 0.0002, 1e-5, 0],
}


OPEN3D = {"width": 1024, "height": 768, "intrinsic_matrix": [800, 0, 0, 0, 810, 0, 511.5, 383.5, 1]}


NAMED = {"cam0": {"K": MATRIX, "D": [*BROWN, 0], "image_size": [1024, 768]}}


SPLATTING = json.dumps(
    [
        {
            "id": k,
            "img_name": f"0000{k}",
            "width": 1024,
            "height": 768,
            "position": [0.1, 0.2, 0.3],
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
            "fy": 810.5,
            "fx": 800.25,
        }
        for k in (0, 1)
    ]
)


RECONSTRUCTION = json.dumps([{"cameras": OPENSFM, "shots": {"a.jpg": {"camera": next(iter(OPENSFM))}}, "points": {}}])


MATLAB = {
    "Version": "23.2",
    "RadialDistortion": [-0.28, 0.074],
    "TangentialDistortion": [0.0002, 1e-5],
    "ImageSize": [768, 1024],
    "EstimateSkew": False,
    "NumRadialDistortionCoefficients": 2,
    "IntrinsicMatrix": [[800, 0, 0], [0, 810, 0], [512.5, 384.5, 1]],
}


BOUGUET = """% Intrinsic and Extrinsic Camera Parameters
%-- Focal length:
fc = [ 800.0 ; 810.0 ];
%-- Principal point:
cc = [ 511.5 ; 383.5 ];
%-- Skew coefficient:
alpha_c = 0.0005;
%-- Distortion coefficients:
kc = [ -0.28 ; 0.074 ; 0.0002 ; 0.00001 ; 0.0 ];
%-- Image size:
nx = 1024;
ny = 768;
"""


NERF = {"camera_angle_x": 0.6911112070083618, "w": 800, "h": 800, "frames": [{"file_path": "./train/r_0"}]}


PDS3 = """PDS_VERSION_ID                    = PDS3
/* FILE DATA ELEMENTS */
RECORD_TYPE                       = FIXED_LENGTH
GROUP                             = SUBFRAME_REQUEST_PARMS
 FIRST_LINE                       = 1
 LINES                            = 4
 LINE_SAMPLES                     = 4
END_GROUP                         = SUBFRAME_REQUEST_PARMS
GROUP                             = GEOMETRIC_CAMERA_MODEL
 ^MODEL_DESC                      = "GEOMETRIC_CM.TXT"
 CALIBRATION_SOURCE_ID            = "73"
 MODEL_TYPE                       = CAHVOR
 MODEL_COMPONENT_ID               = ("C","A","H","V","O","R")
 MODEL_COMPONENT_NAME             = ("CENTER","AXIS","HORIZONTAL","VERTICAL",
                                     "OPTICAL","RADIAL")
 MODEL_COMPONENT_1                = (0.6,0.5,-1.9)
 MODEL_COMPONENT_2                = (0.800000,0.000000,0.600000)
 MODEL_COMPONENT_3                = (407.2,1210.0,305.4)
 MODEL_COMPONENT_4                = (-308.8,0.0,1278.4)
 MODEL_COMPONENT_5                = (0.806,0.012,0.592)
 MODEL_COMPONENT_6                = (-0.0003,-0.13,0.18)
 REFERENCE_COORD_SYSTEM_NAME      = "ROVER_NAV_FRAME"
END_GROUP                         = GEOMETRIC_CAMERA_MODEL
OBJECT                            = IMAGE
 INTERCHANGE_FORMAT               = BINARY
 LINES                            = 1024
 LINE_SAMPLES                     = 1024
 SAMPLE_BITS                      = 16
END_OBJECT                        = IMAGE
END
"""


VICAR = (
    "LBLSIZE=2048            FORMAT='HALF'  TYPE='IMAGE'  BUFSIZ=20480  DIM=3  EOL=0  RECSIZE=2048  ORG='BSQ'  "
    "NL=1024  NS=1024  NB=1  N1=1024  N2=1024  PROPERTY='IDENTIFICATION'  FRAME_ID='LEFT'  "
    "PROPERTY='GEOMETRIC_CAMERA_MODEL'  CALIBRATION_SOURCE_ID='1'  MODEL_TYPE='CAHVORE'  "
    "MODEL_COMPONENT_ID=('C', 'A', 'H', 'V', 'O', 'R', 'E', 'T', 'P')  MODEL_COMPONENT_1=(0.6, 0.5, -1.9)  "
    "MODEL_COMPONENT_2=(0.8, 0.0, 0.6)  MODEL_COMPONENT_3=(404.0, 480.0, 303.0)  "
    "MODEL_COMPONENT_4=(122.6, 0.0, 693.2)  MODEL_COMPONENT_5=(0.806, 0.012, 0.592)  "
    "MODEL_COMPONENT_6=(0.0001, -0.03, 0.004)  MODEL_COMPONENT_7=(0.0005, 0.001, -0.0002)  "
    "MODEL_COMPONENT_8=3.0  MODEL_COMPONENT_9=0.46  TASK='MARSCAHV' "
)


PDS4 = """<?xml version="1.0" encoding="UTF-8"?>
<Product_Observational xmlns="http://pds.nasa.gov/pds4/pds/v1" xmlns:geom="http://pds.nasa.gov/pds4/geom/v1">
<Observation_Area><Discipline_Area><geom:Geometry><geom:Geometry_Lander>
<geom:Articulation_Device_Parameters><geom:Coordinate_Space_Reference>
<geom:coordinate_space_frame_type>ARM_FRAME</geom:coordinate_space_frame_type>
</geom:Coordinate_Space_Reference></geom:Articulation_Device_Parameters>
<geom:Camera_Model_Parameters>
<geom:model_type>CAHV</geom:model_type>
<geom:CAHV_Model>
<geom:Vector_Center><geom:x_position unit="m">0.6</geom:x_position><geom:y_position unit="m">0.5</geom:y_position>
<geom:z_position unit="m">-1.9</geom:z_position></geom:Vector_Center>
<geom:Vector_Axis><geom:x_unit>0.8</geom:x_unit><geom:y_unit>0.0</geom:y_unit><geom:z_unit>0.6</geom:z_unit>
</geom:Vector_Axis>
<geom:Vector_Horizontal><geom:x_pixel>407.2</geom:x_pixel><geom:y_pixel>1210.0</geom:y_pixel>
<geom:z_pixel>305.4</geom:z_pixel></geom:Vector_Horizontal>
<geom:Vector_Vertical><geom:x_pixel>-308.8</geom:x_pixel><geom:y_pixel>0.0</geom:y_pixel>
<geom:z_pixel>1278.4</geom:z_pixel></geom:Vector_Vertical>
</geom:CAHV_Model>
<geom:Coordinate_Space_Reference><geom:Coordinate_Space_Indexed>
<geom:coordinate_space_frame_type>ROVER_NAV_FRAME</geom:coordinate_space_frame_type>
</geom:Coordinate_Space_Indexed></geom:Coordinate_Space_Reference></geom:Camera_Model_Parameters></geom:Geometry_Lander></geom:Geometry></Discipline_Area>
</Observation_Area>
<File_Area_Observational><Array_2D_Image><axes>2</axes>
<Axis_Array><axis_name>Line</axis_name><elements>960</elements><sequence_number>1</sequence_number></Axis_Array>
<Axis_Array><axis_name>Sample</axis_name><elements>1024</elements><sequence_number>2</sequence_number></Axis_Array>
</Array_2D_Image></File_Area_Observational></Product_Observational>
"""


def directions(n: int = 100, widest: float = 0.45) -> np.ndarray:
    """Normalised coordinates (n, 2) in front of a camera."""
    return np.random.default_rng(11).uniform(-widest, widest, (n, 2))


def brown_image(x: np.ndarray, *lens: float) -> tuple[np.ndarray, np.ndarray]:
    """Distorted coordinates by the formula of Brown's model, written once more; lens: k1 k2 k3 p1 p2 k4 k5 k6."""
    k1, k2, k3, p1, p2, k4, k5, k6 = (*lens, *(0.0,) * (8 - len(lens)))
    (u, v), r2 = x.T, (x**2).sum(axis=1)
    g = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    return u * g + 2 * p1 * u * v + p2 * (r2 + 2 * u * u), v * g + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v


def fisheye_image(x: np.ndarray, *k: float) -> tuple[np.ndarray, np.ndarray]:
    """Distorted coordinates of an equidistant lens theta (1 + k1 theta^2 + ...), written once more."""
    r = np.hypot(*x.T)
    theta = np.arctan(r)
    ratio = theta * (1 + sum(one * theta ** (2 * i) for i, one in enumerate(k, 1))) / r
    return x[:, 0] * ratio, x[:, 1] * ratio


def check_pixels(camera: Camera, x: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
    """The camera sees directions x (n, 2) where the tool's formula puts them, to 1e-6 px, and back."""
    uv = np.column_stack([u, v])
    assert np.abs(pixels_from_rays(camera, x) - uv).max() < 1e-6
    assert np.abs(rays_from_pixels(camera, uv) - x).max() * camera.focal_px < 1e-6


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
    "opensfm-reconstruction": (RECONSTRUCTION, "OpenSfM"),
    "camodocal": (CAMODOCAL, "CamOdoCal"),
    "orbslam": (ORBSLAM, "ORB-SLAM"),
    "autoware": (AUTOWARE, "Autoware"),
    "alicevision": (ALICEVISION, "AliceVision"),
    "realsense": (REALSENSE, "RealSense"),
    "named": (NAMED, "OpenCV"),
    "matlab": (MATLAB, "MATLAB"),
}
