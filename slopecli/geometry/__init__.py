"""Two-view geometry of planes: NumPy arrays in, arrays and dataclasses out.

Points are rows of float64 arrays (n, 2) in normalised coordinates, angles are radians, `P2 = R (P1 - T)`, homographies
map image 1 to image 2, planes are scaled normals with `N.P = 1`; see docs/conventions.md.

>>> from slopecli.geometry import measure_slopes, solve_planes
>>> solution = solve_planes(x1, x2, patch)  # patch (n,): number of each point's plane, -1 for none
>>> slopes = measure_slopes(solution, up_cam1)
"""

from slopecli.face import lazy_names
from slopecli.geometry.alignment import Alignment, align_homographies
from slopecli.geometry.decomposition import PlaneMotion, decompose_homography, longuet_higgins
from slopecli.geometry.epipolar import epipolar_distance, essential_matrix, focus_of_expansion
from slopecli.geometry.homography import apply_homography, fit_homography, homography_in_pixels, homography_of_plane
from slopecli.geometry.metrics import direction_angle, normal_angle, rotation_angle
from slopecli.geometry.slope import measure_slopes, surface_normals
from slopecli.geometry.solver.solve import solve_planes
from slopecli.geometry.solver.uncertainty import cramer_rao_bound
from slopecli.geometry.tilt_distribution import probability_below, slope_interval

__all__ = [
    "Alignment",
    "PlaneMotion",
    "align_homographies",
    "apply_homography",
    "cramer_rao_bound",
    "decompose_homography",
    "direction_angle",
    "epipolar_distance",
    "essential_matrix",
    "fit_homography",
    "focus_of_expansion",
    "homography_in_pixels",
    "homography_of_plane",
    "longuet_higgins",
    "measure_slopes",
    "normal_angle",
    "probability_below",
    "rotation_angle",
    "slope_interval",
    "solve_planes",
    "surface_normals",
]

# used by other rooms, tests and notebooks; loaded when first asked for
__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "alignment": "reprojection_error solve_base_homography solve_delta_normals",
        "camera": "OUTSIDE_PX pinhole_of pixels_from_rays points_on_plane rays_from_pixels scale_camera "
        "undistortion_maps",
        "epipolar": "homogeneous rotation_from_vector rotation_vector tangent_basis",
        "homography": "four_point_homographies",
        "lens_misfit": "LensMisfit find_lens_misfit fit_lens_misfit",
        "motion": "MotionEstimate assess_motion epipolar_residual inverse_depth refine_motion",
        "plane_fit": "RobustPlane robust_plane",
        "slope": "CAMERA_UP",
        "statistics": "CHI2_MEDIAN CHI2_MEDIAN_2 GATE_SIGMAS MAD_FACTOR geman_mcclure median "
        "robust_least_squares robust_sigma",
        "tilt_distribution": "disc_probability",
        "tilt_error": "tilt_growth",
        "unmatched_tilt": "lever",
    },
)
