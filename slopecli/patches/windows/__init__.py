"""The windows finder: rectangles of image 1 given by the user, each matched by itself."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "dense_planes": "with_steps",
        "known_orientations": "known_planes with_known_orientations",
        "ground_bend": "bend_rad",
        "unmatched_parts": "beside_rad confirmed_cells contradicting_cells gaps_of stepped_rad surer_along unseen_rad",
        "window_finder": "REMATCHERS match_window window_patch",
    },
)
