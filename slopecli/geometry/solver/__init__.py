"""The joint solution: one motion and one normal per patch, with covariance and every root."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "coplanar": "AT merge_coplanar",
        "focal_start": "start_by_lines",
        "free_camera": "Freed focal_by_lines free_focal free_parameter lines_explain",
        "intrinsics": "PARAMETERS CameraScore Settled score_camera with_planes",
        "many_views": "ViewsSolution",
        "mismatches": "chi2_quantile",
        "observations": "linearise observe predict",
        "one_thread": "SharedLimit one_blas_thread",
        "priors": "MotionPrior",
        "refinement": "State normal_equations optimal_normals step",
        "multiview": "cramer_rao_bound_of_views solve_views",
        "reference_change": "LaterViews last_view with_later_views",
        "seen_points": "Sightings changed thinned",
        "scatter": "amplitude_of linearised scatter_of with_scatter",
        "starts": "starting_states",
        "uncertainty": "Covariance cramer_rao_bound small_sample",
    },
)
