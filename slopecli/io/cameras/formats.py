"""The camera formats that are read, one row each. A new format is one module beside this one and one row here."""

from __future__ import annotations

from types import ModuleType
from typing import NamedTuple

from slopecli.io.cameras import (
    alicevision,
    autoware,
    bare_matrix,
    camera_sets,
    camodocal,
    colmap,
    jpl,
    kalibr,
    kitti,
    matlab,
    metashape,
    middlebury,
    native,
    nerfstudio,
    open3d,
    opencv,
    openmvg,
    opensfm,
    orbslam,
    pix4d,
    realsense,
    ros,
    splatting,
)


class CameraFormat(NamedTuple):
    """One format of camera files.

    name : in messages, in docs/cameras.md and at the start of `Camera.source`.
    module : with functions.
        find(CameraFileContent) -> cameras by name ("" when they have none); {} if the file is of another format.
        read(one of these cameras, image size to use where the file gives none) -> Camera in OpenCV's convention
        (px, pixel centres at integers); raises InputError for a camera that is not supported.
        and where need be images_called(name of a camera) -> what its images or their folder are called;
        labelled_images(CameraFileContent, `Beside`) -> names of cameras by the names of their images.
    stems : names, lower case and without suffix, under which `slopemap batch` looks for such files beside the images.
    files, recognised_by, lenses, converted : the columns of the table in docs/cameras.md, Markdown.
    """

    name: str
    module: ModuleType
    stems: str
    files: str
    recognised_by: str
    lenses: str
    converted: str = ""


# In the order in which they are tried; formats that look at text or binary data come before those that parse a tree.
CAMERA_FORMATS = (
    CameraFormat(
        "JPL",
        jpl,
        stems="",
        files="labels of Mars images: PDS3 `.LBL`, PDS4 `.xml`, or in front of the pixels of PDS3 and VICAR images",
        recognised_by="`GEOMETRIC_CAMERA_MODEL`; `CAHV_Model`, `CAHVOR_Model`, `CAHVORE_Model`",
        lenses="CAHV, CAHVOR, CAHVORE with its pupil at C",
        converted="camera axes: z along A, y along the part of V across A",
    ),
    CameraFormat(
        "COLMAP",
        colmap,
        stems="cameras",
        files="`cameras.txt`, `cameras.bin`",
        recognised_by="lines of id, model, width, height and parameters; binary camera records",
        lenses=" ".join(f"`{model}`" for model, names in colmap.MODELS.items() if isinstance(names, str)),
        converted="half a pixel: COLMAP's pixel centres are at (0.5, 0.5)",
    ),
    CameraFormat(
        "Pix4D",
        pix4d,
        stems="pix4d calibrated_internal_camera_parameters",
        files="`..._calibrated_internal_camera_parameters.cam`",
        recognised_by="`Pix4D camera calibration file`",
        lenses="perspective, K1 K2 K3 T1 T2",
        converted="millimetres by the sensor's width in the file and the image's in pixels; half a pixel",
    ),
    CameraFormat(
        "KITTI",
        kitti,
        stems="calib calib_cam_to_cam",
        files="`calib.txt`, `calib_cam_to_cam.txt`, one file a frame of the object set",
        recognised_by="lines `P0:`, `P_rect_00:`, `K_00:`",
        lenses="none (`P...`, rectified images); 5 coefficients (`K_...`, images as recorded)",
    ),
    CameraFormat(
        "Middlebury",
        middlebury,
        stems="calib",
        files="`calib.txt` of the stereo sets since 2014",
        recognised_by="`cam0=[`",
        lenses="none",
    ),
    CameraFormat(
        "matrix",
        bare_matrix,
        stems="k intrinsic intrinsics cam_k",
        files="`K.txt`, `K.npy`, `intrinsic_color.txt`: 9, 12 or 16 numbers",
        recognised_by="nothing but numbers",
        lenses="none; skew",
    ),
    CameraFormat(
        "MATLAB",
        matlab,
        stems="calib_results cameraparams",
        files="struct of `cameraParameters` or `cameraIntrinsics` as JSON or `.mat`; Bouguet's `Calib_Results`, `.m` "
        "or `.mat`",
        recognised_by="`RadialDistortion` with `TangentialDistortion`; `fc = [`",
        lenses="4 or 5 coefficients, skew",
        converted="of the toolbox: pixels count from 1, rows come before columns, IntrinsicMatrix is transposed",
    ),
    CameraFormat(
        "Metashape",
        metashape,
        stems="calibration cameras",
        files="exported calibration, or cameras XML; the adjusted calibration is preferred to the initial one",
        recognised_by="XML with `calibration` elements",
        lenses="`frame` with k1 k2 k3 k4 p1 p2 b1 b2; `fisheye` with k1 k2 k3 k4",
        converted="half a pixel; p1 and p2 change places; cx and cy from the middle",
    ),
    CameraFormat(
        "Kalibr",
        kalibr,
        stems="camchain sensor",
        files="`camchain.yaml`, EuRoC `sensor.yaml`",
        recognised_by="`camera_model` with `intrinsics`, or under `cam0`, `cam1`, ...",
        lenses="pinhole with `radtan`, `equidistant` or none",
    ),
    CameraFormat(
        "ROS camera_info",
        ros,
        stems="camera_info camerainfo",
        files="calibration file, output of `topic echo` (ROS 1 and 2)",
        recognised_by="`distortion_model` with `camera_matrix`, `K` or `k`",
        lenses="`plumb_bob`, `rational_polynomial`, `equidistant`",
        converted="region of interest and binning, where there are any; K is that of the raw image, P is not read",
    ),
    CameraFormat(
        "CamOdoCal",
        camodocal,
        stems="cam camera",
        files="camera files of CamOdoCal, VINS-Mono, VINS-Fusion",
        recognised_by="`model_type` with `projection_parameters`",
        lenses="`PINHOLE` `PINHOLE_FULL` `KANNALA_BRANDT`",
        converted="k2 to k5 of KANNALA_BRANDT are k1 to k4",
    ),
    CameraFormat(
        "ORB-SLAM",
        orbslam,
        stems="",
        files="settings of ORB-SLAM2, ORB-SLAM3 and stella_vslam",
        recognised_by="`Camera.fx`, `Camera1.fx`, or `fx` below `Camera`",
        lenses="`PinHole` `KannalaBrandt8` `Rectified`",
    ),
    CameraFormat(
        "Autoware",
        autoware,
        stems="",
        files="calibration YAML",
        recognised_by="`CameraMat`",
        lenses="as `DistModel` says",
    ),
    CameraFormat(
        "nerfstudio",
        nerfstudio,
        stems="transforms",
        files="`transforms.json`, also of instant-ngp and NeRF; intrinsics of the file, of its frames, or of both",
        recognised_by="`fl_x` or `camera_angle_x`, at the root or in frames",
        lenses="`OPENCV`, `OPENCV_FISHEYE`, `PINHOLE`",
        converted="half a pixel, as COLMAP; camera_angle_x by the image's width",
    ),
    CameraFormat(
        "OpenSfM",
        opensfm,
        stems="cameras camera_model camera_models cameramodel cameramodels reconstruction",
        files="`camera_models.json`, `cameras.json`, `reconstruction.json`, also of OpenDroneMap",
        recognised_by="`projection_type`",
        lenses="`perspective` `simple_radial` `radial` `brown` `fisheye` `fisheye_opencv`",
        converted="from units of the longer side, measured from the middle of the image",
    ),
    CameraFormat(
        "3D Gaussian splatting",
        splatting,
        stems="cameras",
        files="`cameras.json`",
        recognised_by="`img_name` with `fx` and `fy`",
        lenses="none",
        converted="the principal point, which it does not have, is the middle of the image",
    ),
    CameraFormat(
        "OpenMVG",
        openmvg,
        stems="sfm_data",
        files="`sfm_data.json`",
        recognised_by="`intrinsics` with `ptr_wrapper`",
        lenses=" ".join(f"`{kind}`" for kind in openmvg.LENSES),
    ),
    CameraFormat(
        "AliceVision",
        alicevision,
        stems="sfm cameras",
        files="`cameras.sfm`, `sfm.json`, also of Meshroom",
        recognised_by="`intrinsics` with `intrinsicId`",
        lenses=" ".join(f"`{kind}`" for kind in alicevision.LENSES),
        converted="by the version of the file: focal length from millimetres, principal point from the middle",
    ),
    CameraFormat(
        "RealSense",
        realsense,
        stems="",
        files="`rs2_intrinsics` as JSON",
        recognised_by="`ppx`, `ppy`, `fx`, `fy`",
        lenses="none, `brown_conrady`, `kannala_brandt4`; others where all coefficients are 0",
    ),
    CameraFormat(
        "Open3D",
        open3d,
        stems="camera_intrinsic",
        files="`camera_intrinsic.json`, `PinholeCameraParameters`",
        recognised_by="`intrinsic_matrix`, column by column",
        lenses="none",
    ),
    CameraFormat(
        "native",
        native,
        stems="camera cam intrinsic intrinsics",
        files="JSON or YAML as above",
        recognised_by="`fx`, or `K` and no other keys than the native ones",
        lenses="none, up to 8 coefficients in a list or each by its name, fisheye, and JPL's and Metashape's",
    ),
    CameraFormat(
        "OpenCV",
        opencv,
        stems="calib calibration intrinsic intrinsics",
        files="FileStorage YAML, XML, JSON; plain JSON or YAML; `.npz`",
        recognised_by="names in use for a matrix: `camera_matrix`, `cameraMatrix`, `K`, `mtx`, `M1`, ...; "
        "coefficients as `distortion_coefficients`, `distCoeffs`, `D`, `dist`, `D1`, ...",
        lenses="none, 4, 5 or 8 coefficients, fisheye",
    ),
    CameraFormat(
        "named cameras",
        camera_sets,
        stems="cameras rig",
        files='several cameras under names of their own: `{"cam0": {"K": ..., "D": ...}}`, camera_info by topic',
        recognised_by="under each name what ROS, RealSense, native or OpenCV files have",
        lenses="as these",
    ),
)
