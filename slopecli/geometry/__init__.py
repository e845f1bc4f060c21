"""Two-view geometry of planes: NumPy arrays in, arrays and dataclasses out.

Points are rows of float64 arrays (n, 2) in normalised coordinates, angles are radians, `P2 = R (P1 - T)`, homographies
map image 1 to image 2, planes are scaled normals with `N.P = 1`; see docs/conventions.md.

>>> from slopecli.geometry import measure_slopes, solve_planes
>>> solution = solve_planes(x1, x2, patch)  # patch (n,): number of each point's plane, -1 for none
>>> slopes = measure_slopes(solution, up_cam1)
"""

from slopecli.face import lazy_names
from slopecli.geometry.slope import measure_slopes
from slopecli.geometry.solver.solve import solve_planes

__all__ = ["measure_slopes", "solve_planes"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "alignment": "Alignment align_homographies reprojection_error solve_base_homography solve_delta_normals",
        "attitude": "about_line_of_sight forward_angles_deg ned_displacement ned_from_camera",
        "camera": "OUTSIDE_PX pinhole_of pixels_from_rays points_on_plane radial_term rays_from_pixels scale_camera "
        "share_with_rays undistortion_maps with_radial_term",
        "epipolar": "direction_angle epipolar_distance essential_matrix focus_of_expansion homogeneous normal_angle "
        "rotation_angle rotation_from_vector rotation_vector tangent_basis",
        "homography": "PlaneMotion apply_homography decompose_homography fit_homography four_point_homographies "
        "homography_in_pixels homography_of_plane longuet_higgins",
        "motion": "LensMisfit MotionEstimate assess_motion epipolar_residual find_lens_misfit fit_lens_misfit "
        "inverse_depth refine_motion",
        "orientation": "kept_orientation",
        "plane_fit": "RobustPlane lever robust_plane",
        "slope": "CAMERA_UP normal_covariances surface_normals tilt_growth",
        "solver.many_views": "ViewsSolution",
        "solver.multiview": "cramer_rao_bound_of_views solve_views",
        "solver.uncertainty": "cramer_rao_bound",
        "statistics": "CHI2 GATE_SIGMAS MAD_FACTOR geman_mcclure median robust_least_squares robust_sigma",
        "tilt_distribution": "disc_probability probability_below slope_interval",
    },
)
