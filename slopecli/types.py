"""Frozen dataclasses that all rooms share: camera, image, solution, and the report that slopes.json is written from.

Frames and units: docs/conventions.md. A field whose unit is not that of `geometry/` (radians, normalised coordinates,
baselines) has it in its name. The dataclasses from `ImageInfo` to `Report` have the keys of slopes.json.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slopecli.face import ReportForms
from slopecli.options import Place

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

CameraModel = Literal["pinhole", "brown", "fisheye", "polynomial", "cahvor", "division"]
Verdict = Literal["safe", "unsafe", "undecided"]


@dataclass(frozen=True)
class Camera:
    """Intrinsics of one camera, px; distortion: () for "pinhole", k1 k2 p1 p2 k3 k4 k5 k6 for "brown", k1 k2 k3 k4 for
    "fisheye" (OpenCV), k1 k2 p1 p2 k3 k4 skew for "polynomial", R0 R1 R2 tilt (x, y) linearity skew for "cahvor",
    k for "division". size_given: whether the size is the camera's own, not an image's; note: how it was read."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    model: CameraModel = "pinhole"
    distortion: tuple[float, ...] = ()
    source: str = "given"
    size_given: bool = field(default=True, compare=False)
    note: str = field(default="", compare=False)

    @property
    def K(self) -> FloatArray:
        """(3, 3) intrinsic matrix, px."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def focal_px(self) -> float:
        """Geometric mean focal length: pixels per unit of normalised coordinate."""
        return float(np.sqrt(self.fx * self.fy))


@dataclass(frozen=True, eq=False)
class Image:
    """One image: `grey` (h, w), `colour` (h, w, 3) BGR or None when it is grey; note: how its file was read, or ""."""

    grey: NDArray[np.uint8]
    colour: NDArray[np.uint8] | None = None
    path: str = ""
    sha256: str = ""
    note: str = ""

    @property
    def width(self) -> int:
        return int(self.grey.shape[1])

    @property
    def height(self) -> int:
        return int(self.grey.shape[0])


@dataclass(frozen=True, eq=False)
class Ambiguity:
    """Whether a second root is left. delta_chi2: how much worse it fits, None without one; delta_chi2_prior: the part
    of it that is due to the prior, None without. joined: both roots lie in one broad minimum."""

    status: Literal["none", "resolved", "unresolved"] = "none"
    delta_chi2: float | None = None
    alternative: Solution | None = None
    delta_chi2_prior: float | None = None
    joined: bool = False


@dataclass(frozen=True, eq=False)
class Solution:
    """One motion and one scaled normal per patch, consistent with a single epipolar geometry.

    R : (3, 3) rotation, camera 1 to camera 2.  T : (3,) unit vector, position of camera 2 in camera-1 axes.
    scaled_normals : (m, 3), unit 1/baseline, N.P = 1, with their normal_covariance (m, 3, 3), motion included.
    motion_covariance : (5, 5) of (rotation vector w in R <- exp([w]x) R, rad; two coordinates of T, rad, in `tangent`).
    tangent : (3, 2) orthonormal basis of the plane perpendicular to T that the last two coordinates refer to.
    normal_gain : (m, 3, 5) d N_i / d motion at the optimum, so that cov(N_i, N_j) = G_i C G_j^T for i != j.
    noise : 1-sigma of a normalised coordinate in image 2, given, or estimated where residuals exceed it.
    relief : (m,) RMS height of the points off their plane over its distance, 0 where points are held coplanar.
    joint_normals : (3m, 3m) covariance of all normals, where they share more than the motion; None where they do not.
    inlier : (n,) which correspondences were kept.  rms : of their residuals in image 2, normalised coordinates.
    chi2 : weighted sum of squares at the optimum.  prior_chi2 : its growth due to a prior of the motion; None without.
    noise_gain : factor on standard errors for errors that neighbouring correspondences share.
    focal_shift : (3m + 5,) change of all normals and the motion by 1-sigma of the focal length; in the covariances.
    """

    R: FloatArray
    T: FloatArray
    scaled_normals: FloatArray
    normal_covariance: FloatArray
    motion_covariance: FloatArray
    tangent: FloatArray
    normal_gain: FloatArray
    noise: float
    relief: FloatArray
    rms: float
    chi2: float
    inlier: BoolArray
    converged: bool
    iterations: int
    noise_gain: float
    solver: str = "mle"
    ambiguity: Ambiguity = field(default_factory=Ambiguity)
    prior_chi2: float | None = None
    joint_normals: FloatArray | None = None
    focal_shift: FloatArray | None = None

    @property
    def direction_covariance(self) -> FloatArray:
        """(3, 3) covariance of the unit vector T (rank 2)."""
        return self.tangent @ self.motion_covariance[3:, 3:] @ self.tangent.T

    def cross_covariance(self, i: int, j: int) -> FloatArray:
        """(3, 3) covariance of scaled normals i and j; they share the motion."""
        if i == j:
            return self.normal_covariance[i]
        if self.joint_normals is not None:
            return self.joint_normals[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        if self.focal_shift is None:
            return self.normal_gain[i] @ self.motion_covariance @ self.normal_gain[j].T
        normals, motion = self.focal_shift[:-5].reshape(-1, 3), np.outer(self.focal_shift[-5:], self.focal_shift[-5:])
        own = self.normal_gain[i] @ (self.motion_covariance - motion) @ self.normal_gain[j].T
        return own + np.outer(normals[i], normals[j])


@dataclass(frozen=True, eq=False)
class Slopes:
    """Per plane: slope (0..pi), its 1-sigma, aspect (downhill azimuth, NaN when undefined) and its 1-sigma, rad;
    tilt_covariance (m, 2, 2) of the normal, rad^2: along the slope (row 0) and across it (row 1)."""

    slope_rad: FloatArray
    sigma_rad: FloatArray
    aspect_rad: FloatArray
    aspect_sigma_rad: FloatArray
    tilt_covariance: FloatArray


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Pixels (h, w) of a working image: gradient, grey levels per px; components, 1 the largest; planes."""

    gradient: NDArray[np.float32]
    threshold: float
    components: NDArray[np.int32]
    merged: NDArray[np.int32]  # planes of the labels 1..k, 0 for none
    account: tuple[str, ...] = ()  # what was proposed, labelled and given up


@dataclass(frozen=True)
class ImageInfo:
    path: str
    width: int | None
    height: int | None
    sha256: str


@dataclass(frozen=True)
class Up:
    """What slopes are measured against. plane_id : of the plane that is taken as level, if up is its normal.
    otherwise_cam1 : up, unit, as the evidence against the assumed one suggests; None where nothing was doubted."""

    vector_cam1: tuple[float, float, float]
    source: Literal["camera", "given", "dominant-plane", "exif"]
    sigma_deg: float = 0.0
    plane_id: int | None = None
    otherwise_cam1: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Scale:
    unit: Literal["baseline", "m"] = "baseline"
    source: Literal["none", "baseline", "altitude", "pose", "exif"] = "none"
    sigma: float | None = None  # relative 1-sigma of lengths; None while they are in baselines


@dataclass(frozen=True, eq=False)
class Motion:
    """`baseline_cam1`: position of camera 2 in camera-1 axes, in the unit of `scale`."""

    rotation_cam2_from_cam1: FloatArray
    baseline_cam1: FloatArray
    rotation_deg: float
    rotation_sigma_deg: float | None
    direction_sigma_deg: float | None


@dataclass(frozen=True)
class Fit:
    solver: str
    refine: str
    rms_px: float
    noise_px: float
    iterations: int
    converged: bool
    n_correspondences: int
    n_inliers: int
    rms_mrad: float | None = None  # in place of px, where there is no camera
    noise_mrad: float | None = None
    focal_factor: float | None = None  # focal length that the images prefer over that given; None where not told
    focal_factor_sigma: float | None = None


@dataclass(frozen=True, eq=False)
class AlternativePlane:
    """A plane in the second root; as a `Plane`, but `p_safe` is that of this root alone."""

    id: int
    normal_cam1: FloatArray
    distance: float
    slope_deg: float
    slope_sigma_deg: float | None
    slope_ci95_deg: tuple[float, float] | None
    aspect_deg: float | None
    dip_direction_deg: float | None
    verdict: Verdict | None
    p_safe: float | None
    slope_known: bool = True
    azimuth_sigma_deg: float | None = None

    @property
    def taken_as_level(self) -> bool:
        """Whether it defines what is level, in this root too."""
        return self.verdict is None


@dataclass(frozen=True, eq=False)
class Alternative:
    motion: Motion
    planes: tuple[AlternativePlane, ...]


@dataclass(frozen=True, eq=False)
class AmbiguityReport:
    status: Literal["none", "resolved", "unresolved"]
    delta_chi2: float | None = None
    delta_chi2_prior: float | None = None
    resolve_with: str | None = None
    alternative: Alternative | None = None

    @property
    def others(self) -> dict[int, AlternativePlane]:
        """Planes of the second root by id, where it is not ruled out."""
        if self.status != "unresolved" or self.alternative is None:
            return {}
        return {plane.id: plane for plane in self.alternative.planes}


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane of a patch. normal_cam1 points out of the surface; distance, roughness, p_safe: see docs/output.md.
    The plane that is taken as level has slope 0 by that definition; its sigma, interval, verdict and p_safe are None.
    """

    id: int
    source: str
    polygon_px: FloatArray
    normal_cam1: FloatArray
    distance: float
    slope_deg: float
    slope_sigma_deg: float | None
    slope_ci95_deg: tuple[float, float] | None
    aspect_deg: float | None
    dip_direction_deg: float | None
    n_correspondences: int
    n_inliers: int
    rms_px: float
    roughness: float
    homography_px: FloatArray
    verdict: Verdict | None
    p_safe: float | None
    status: Literal["ok", "poor"] = "ok"
    reason: str | None = None
    slope_known: bool = True  # its sigma is at most `max_sigma_deg`; not in JSON, which has both numbers
    rms_mrad: float | None = None
    slope_sigma_causes_deg: dict[str, float] | None = None  # parts of the sigma; their squares add up to its square
    azimuth_sigma_deg: float | None = None  # of aspect_deg and dip_direction_deg
    normal_covariance_cam1: FloatArray | None = None  # (3, 3) of normal_cam1, deg^2, whatever up is; None: not known
    noun: str = "window"  # what messages call it; this and `found` follow from its source and are not in JSON
    found: bool = False  # it was found in the image (any shape), not given as a window or as correspondences

    @property
    def taken_as_level(self) -> bool:
        """Whether it defines what is level; it has no verdict then."""
        return self.verdict is None


@dataclass(frozen=True, eq=False)
class Rejected:
    id: int
    polygon_px: FloatArray
    reason: str
    message: str


@dataclass(frozen=True)
class Diagnostic:
    code: str
    severity: Literal["info", "warning", "error"]
    message: str
    value: float | None = None
    remedy: str | None = None


@dataclass(frozen=True, eq=False)
class Report(ReportForms):
    """Everything the files and the table are made from. `labels` (h, w): plane id per pixel, 0 for none. A window is
    the rectangle `polygon_px`; a plane that was found is the pixels of its id, perhaps in several pieces."""

    images: tuple[ImageInfo, ImageInfo]
    cameras: tuple[Camera, Camera]
    options: dict[str, Any]
    up: Up
    scale: Scale
    motion: Motion
    fit: Fit
    ambiguity: AmbiguityReport
    planes: tuple[Plane, ...]
    rejected: tuple[Rejected, ...]
    diagnostics: tuple[Diagnostic, ...]
    labels: NDArray[np.uint16]
    epipole1_px: tuple[float, float] | None = None
    segmentation: Segmentation | None = None
    place: Place | None = None

    @property
    def found(self) -> bool:
        """Whether any of its planes was found in the image, rather than given."""
        return any(plane.found for plane in self.planes)

    @property
    def noun(self) -> str:
        """What messages call its patches."""
        return self.planes[0].noun if self.planes else "window"
