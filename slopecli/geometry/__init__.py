"""Pure two-view geometry: arrays in, arrays and dataclasses out; float64, radians, rows of points."""

from slopecli.geometry.alignment import align_homographies
from slopecli.geometry.decomposition import PlaneMotion, decompose_homography
from slopecli.geometry.homography import apply_homography, fit_homography, homography_in_pixels, homography_of_plane
from slopecli.geometry.solve import solve_planes

__all__ = [
    "PlaneMotion",
    "align_homographies",
    "apply_homography",
    "decompose_homography",
    "fit_homography",
    "homography_in_pixels",
    "homography_of_plane",
    "solve_planes",
]
