"""Every choice a user can make, with its default, its unit and why it is what it is. Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

MIN_SIDE_PX = 16  # of a window, or an image: nothing can be matched in less
MANY_WINDOWS = 64  # 8 x 8, from which on windows are answered together, and shown as a map
MOST_SIGMA_DEG = 60.0  # bound of max_sigma_deg: with a larger 1-sigma any slope is possible


@dataclass(frozen=True)
class CameraChoice:
    """How the user gives the camera of one image; exactly one of the fields is set.

    file : path of a camera file, with #NAME if it holds several.
    intrinsics : fx, fy, cx, cy, px.
    fov_deg : horizontal field of view, principal point in the centre.
    exif : whether it is the one that the metadata of the image state.
    """

    file: str | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    fov_deg: float | None = None
    exif: bool = False


@dataclass(frozen=True)
class Pose:
    """A known motion P2 = R (P1 - T): R row by row, and T, where camera 2 is in camera-1 axes, in metres."""

    rotation: tuple[float, ...]
    baseline_m: tuple[float, float, float]


@dataclass(frozen=True)
class Position:
    """Where a camera was, WGS 84: degrees north and east, metres up (None where they are not known).

    Some makers count the altitude from the level of the sea, some from the ellipsoid, up to 100 m apart.

    sigma_m : 1-sigma north and east, each.  sigma_up_m : of the altitude.  apart_sigma_m : of the place against another
    one of the same flight, north and east each: most of the error of satellite fixes minutes apart is the same.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None
    sigma_m: float
    sigma_up_m: float
    apart_sigma_m: float


@dataclass(frozen=True)
class Place:
    """Where camera 1 was, and how it was turned, for maps; each part None where it is not known.

    north_cam1 : unit, towards true north along the horizon, camera-1 axes.
    heading_deg : azimuth of the image's up direction on the ground, or of the viewing direction where the camera looks
    at the horizon; heading_sigma_deg : its 1-sigma.
    """

    position: Position | None
    north_cam1: tuple[float, float, float] | None = None
    heading_deg: float | None = None
    heading_sigma_deg: float | None = None


@dataclass(frozen=True)
class MetadataChoice:
    """What is to be taken from the metadata of the images of a pair: of "up", "north", "baseline" and "altitude".

    must : what has to be stated there.  may : what is taken where it is stated.
    yaw_deg, pitch_deg, roll_deg : of camera 1, in place of what they state; see `geometry.attitude`.
    """

    must: tuple[str, ...] = ()
    may: tuple[str, ...] = ()
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None


@dataclass(frozen=True)
class Stated:
    """What is known of how two images were taken besides their pixels; the answer is compared with it.

    up, scale : whether the options' up, and the length that their scale is from, are from metadata of the images.
    notes : what was taken from there, and what was asked for and is missing, for the user.
    attitude1, attitude2 : rotations from camera axes to north, east, down, row by row; None where one is not known.
    attitude_sigma_deg : 1-sigma of an attitude, of its heading above all.
    shown_turn_deg : by which image 1 is turned clockwise to be shown, as its file says; angles are given of it so.
    move_m : from camera 1 to camera 2, metres north, east, down; None where it is not known.  move_sigma_deg : 1-sigma
    of its direction.
    up_off_deg, up_off_sigma_deg : angle between the up that was given and the one that image 1 states, and its 1-sigma.
    position_off_m : the same of positions; each None where one of the two is not known.
    """

    up: bool = False
    scale: bool = False
    notes: tuple[str, ...] = ()
    attitude1: tuple[float, ...] | None = None
    attitude2: tuple[float, ...] | None = None
    attitude_sigma_deg: float = 0.0
    shown_turn_deg: float = 0.0
    move_m: tuple[float, float, float] | None = None
    move_sigma_deg: float = 0.0
    up_off_deg: float | None = None
    up_off_sigma_deg: float | None = None
    position_off_m: float | None = None


@dataclass(frozen=True)
class Options:
    """Options of `slopemap estimate`.

    Windows are (x, y, w, h) in pixels of image 1; `grid` (columns, rows) is used when there are none.
    """

    grid: tuple[int, int] = (3, 3)  # the paper's nine windows
    windows: tuple[tuple[int, int, int, int], ...] = ()
    planes: str = "windows"  # how planes are found: a choice of patches.FINDERS
    min_region_percent: float = 0.3  # of image 1: smaller planes have too few matches to be reliable
    gradient_threshold: float | None = None  # grey levels per px; None: what 60 % of image 1 are below
    merge_px: float = 1.0  # px of image 2 to which the planes of two regions agree that may be merged
    features: Literal["sift", "foerstner"] = "sift"  # foerstner: the paper's corners and correlation
    solver: Literal["mle", "ha", "lh"] = "mle"
    merge_coplanar: bool = False  # solve patches as coplanar or parallel where chi-square allows it
    up: str | tuple[float, float, float] = "camera"  # "camera", "dominant-plane" or a vector in camera-1 axes
    up_sigma_deg: float = 0.0
    north: tuple[float, float, float] | None = None  # None: the image's up direction
    north_sigma_deg: float = 0.0  # 1-sigma of its azimuth
    position: Position | None = None  # of camera 1
    stated: Stated | None = None  # by the metadata of the images; None where they were not read
    rotation_prior: tuple[float, ...] | None = None  # quaternion w, x, y, z of camera 2 from camera 1; 1-sigma, deg
    direction_prior: tuple[float, ...] | None = None  # of the motion, in camera-1 axes: x, y, z; 1-sigma, deg
    pose: Pose | None = None  # known motion, m: only planes are solved, unless it has a sigma
    pose_sigma_deg: float | None = None  # 1-sigma of its rotation and of its direction; None: they are exact
    focal_sigma_percent: float | None = None  # 1-sigma of the focal length; None: 3 of a field of view, else 0
    free_focal: bool = False  # solve with the focal length that the images prefer
    baseline_m: float | None = None
    altitude_m: float | None = None
    scale_sigma_percent: float = 0.0  # 1-sigma of the length that the scale was given by
    tolerance_deg: float = 15.0  # the steepest slope that landers are designed for (paper, section I)
    confidence: float = 0.99
    max_sigma_deg: float = 10.0  # largest 1-sigma of a slope that is reported: "12 +- 24" would be read as 12
    ply_frame: Literal["up", "camera"] = "up"  # axes of patches.ply and cloud.ply: z up, or those of camera 1
    slope_unit: Literal["deg", "percent", "x-in-12"] = "deg"  # of tables, pictures and pages; files of numbers have deg
    seed: int = 0  # of the random draws in the search for motions and planes; the answer hardly depends on it


@dataclass(frozen=True)
class Lander:
    """A vehicle on pads: how many, the diameter of the circle they stand on, and of a pad, in the unit of the scale."""

    pads: int
    diameter: float
    pad: float = 0.0


@dataclass(frozen=True)
class MapOptions:
    """Options of `slopemap map` besides those of the pair. Lengths are in the unit of the scale."""

    footprint_px: float | None = (
        None  # diameter of the disc whose plane a cell has; None: a sixteenth of the short side
    )
    footprint_m: float | None = None  # the same on the ground, m; needs a scale
    spacing_px: int | None = None  # between cells; None: an eighth of the footprint
    max_height: float | None = None  # of what stands above, or lies below, the plane of a safe footprint
    sites: int = 5  # landing sites listed
    site_radius: float | None = (
        None  # of a wanted site, px, or in the unit of a known scale; None: as large as possible
    )
    classes_deg: tuple[float, ...] = (5.0, 10.0, 15.0, 20.0, 30.0)  # edges of the classes of slope that are drawn
    lander: Lander | None = None
