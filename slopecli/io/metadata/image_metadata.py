"""What an image file states of its camera, place and attitude. What it does not state, or not usably, is None."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.attitude import about_line_of_sight, ned_from_camera
from slopecli.io.cameras.values import Size, lens_model, make_camera
from slopecli.options import Position
from slopecli.types import Camera, FloatArray


@dataclass(frozen=True)
class Lens:
    """Focal length and distortion, for an image of `size` (width, height) px.

    centre_px : principal point from the middle of the image, px.
    distortion : k1 k2 p1 p2 k3, or with k4 k5 k6 after them, OpenCV's order.
    sigma : relative 1-sigma of the focal length.  source : where it is from, with the numbers.
    """

    size: Size
    fx: float
    fy: float
    sigma: float
    source: str
    centre_px: tuple[float, float] = (0.0, 0.0)
    distortion: tuple[float, ...] = ()

    def camera(self) -> Camera:
        """The camera of the image; InputError for values that no camera has."""
        width, height = self.size
        (x, y), model = self.centre_px, lens_model("brown" if any(self.distortion) else "pinhole")
        intrinsics = (self.fx, self.fy, (width - 1) / 2 + x, (height - 1) / 2 + y)
        return make_camera(f"EXIF: {self.source}", self.size, intrinsics, model, self.distortion)


@dataclass(frozen=True)
class Attitude:
    """Angles of the camera against north, east, down, degrees; see `geometry.attitude` for their order and zero.

    yaw_deg : None where the heading is not known.
    downward : whether they are angles of a body whose camera looks out of its floor; otherwise its camera looks ahead.
    turn_deg : by which the pixels as stored are to be turned clockwise to be those that the angles are of.
    tilt_sigma_deg, yaw_sigma_deg : 1-sigma of the direction against gravity about each horizontal axis, of the heading.
    """

    pitch_deg: float
    roll_deg: float
    yaw_deg: float | None = None
    downward: bool = False
    turn_deg: float = 0.0
    tilt_sigma_deg: float = 0.0
    yaw_sigma_deg: float = 0.0
    source: str = ""

    @property
    def ned_from_camera(self) -> FloatArray:
        """(3, 3) rotation from camera axes to north, east, down, as if the heading were north where it is not known."""
        shown = ned_from_camera(self.yaw_deg or 0.0, self.pitch_deg, self.roll_deg, downward=self.downward)
        return np.asarray(shown @ about_line_of_sight(self.turn_deg))

    @property
    def up_cam(self) -> tuple[float, float, float]:
        """Unit vector against gravity, camera axes."""
        return _three(-self.ned_from_camera[2])

    @property
    def north_cam(self) -> tuple[float, float, float] | None:
        """Unit vector to true north, camera axes; None where the heading is not known."""
        return None if self.yaw_deg is None else _three(self.ned_from_camera[0])


@dataclass(frozen=True)
class Metadata:
    """Everything that is read of one image file.

    size : (width, height) px as stored.  taken_size : size of the image as taken, where EXIF states it.
    orientation : of EXIF, 1 where the pixels are to be shown as stored.
    relative_altitude_m : height above the place of take-off, which is not the height above the ground.
    heading_deg : of the line of sight from true north, where that is stated without angles of the camera.
    notes : what is stated and could not be used, and why; one clear line each.
    """

    path: str
    size: Size
    orientation: int
    taken_size: Size | None = None
    maker: str = ""
    model: str = ""
    lens: Lens | None = None
    position: Position | None = None
    relative_altitude_m: float | None = None
    attitude: Attitude | None = None
    heading_deg: float | None = None
    notes: tuple[str, ...] = ()


def _three(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector / np.linalg.norm(vector))
    return x, y, z
