"""Images to a scene: sparse and dense matches, the camera motion, and matching on grey values. Reads no files."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "changes": "Change find_changes",
        "dense": "WHOLE Cells dense_cells flow match_exposure overview_cells sparse_transfer spread",
        "depth_edges": "Edges",
        "dense_depth": "DenseDepth depth_cells measure_depth",
        "depth_transfer": "DepthTransfer",
        "features": "EFFORTS FeatureEffort FeatureMemory Grey Images match_descriptors match_sift shrink to_full",
        "foerstner": "SEARCH_PX correlate_windows foerstner_corners match_foerstner",
        "gradient_components": "Labels adaptive_threshold connected_components grown smooth_gradient "
        "without_small_pieces",
        "matches": "Evidence Matches gather_evidence pair_rays scene_planes thin",
        "motions": "Sparse distinct_motions find_motions inliers_of rank_motions starting_motions",
        "noise": "DIFFERENCE_GREY LEAST_MATCH_PX MAX_GAIN NOISE_GREY OVERVIEW_CELL_PX ROUNDING_GREY SYSTEMATIC_PX "
        "WORST_MATCH_PX correlation_gain",
        "photometric": "PlaneFit View align_plane cell_shifts correlation detrend gain_between normalise sweep_planes",
        "scene": "Scene epipolar_axes whole_grid",
        "segments": "Segments find_segments",
        "scene_from_images": "COARSE FINE build_scene feature_matchers find_scene focal_by_features is_decided "
        "may_suffice overview_effort",
        "standing_still": "Still find_still without_still",
        "threads": "single_threaded",
        "transfer_error": "Comparison OUTSIDE TRUNCATED_COST",
        "warp": "Grid Layer Pyramid Transfer block_sum covered cut magnification plane_transfer resample sample_grey "
        "sample_map transfer_map",
    },
)
