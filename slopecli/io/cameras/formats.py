"""The camera formats that are read, one row each. A new format is one module beside this one and one row here."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

from slopecli.io.cameras import colmap, kalibr, metashape, native, nerfstudio, opencv, opensfm, ros


@dataclass(frozen=True)
class CameraFormat:
    """One format of camera files.

    name : in messages, in docs/cameras.md and at the start of `Camera.source`.
    module : with two functions.
        find(CameraFileContent) -> cameras by name ("" when they have none); {} if the file is of another format.
        read(one of these cameras, image size to use where the file gives none) -> Camera in OpenCV's convention
        (px, pixel centres at integers); raises InputError for a camera that is not supported.
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
        "COLMAP",
        colmap,
        stems="cameras",
        files="`cameras.txt`, `cameras.bin`",
        recognised_by="lines of id, model, width, height and parameters; binary camera records",
        lenses=" ".join(f"`{model}`" for model, names in colmap.MODELS.items() if isinstance(names, str)),
        converted="half a pixel: COLMAP's pixel centres are at (0.5, 0.5)",
    ),
    CameraFormat(
        "Metashape",
        metashape,
        stems="calibration cameras",
        files="exported calibration, or cameras XML; the adjusted calibration is preferred to the initial one",
        recognised_by="XML with `calibration` elements",
        lenses="`frame` with k1 k2 k3 p1 p2, b1",
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
        converted="region of interest and binning; K is that of the raw image, P is not read",
    ),
    CameraFormat(
        "nerfstudio",
        nerfstudio,
        stems="transforms",
        files="`transforms.json`, intrinsics of the file, of its frames, or of both together",
        recognised_by="`fl_x`, at the root or in frames",
        lenses="`OPENCV`, `OPENCV_FISHEYE`, `PINHOLE`",
        converted="half a pixel, as COLMAP",
    ),
    CameraFormat(
        "OpenSfM",
        opensfm,
        stems="cameras camera_model camera_models cameramodel cameramodels",
        files="`camera_models.json`, `cameras.json`, also of OpenDroneMap",
        recognised_by="`projection_type`",
        lenses="`perspective` `simple_radial` `radial` `brown` `fisheye` `fisheye_opencv`",
        converted="from units of the longer side, measured from the middle of the image",
    ),
    CameraFormat(
        "native",
        native,
        stems="camera cam intrinsic intrinsics",
        files="JSON or YAML as above",
        recognised_by="`fx`, or `K` and no other keys than the native ones",
        lenses="none, up to 8 coefficients, fisheye",
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
)
