"""The windows finder: rectangles of image 1 given by the user, each matched by itself."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "known_orientations": "known_planes with_known_orientations",
        "unmatched_parts": "bend_rad beside_rad confirmed_cells contradicting_cells gaps_of stepped_rad unseen_rad",
        "window_finder": "REMATCHERS match_window window_patch",
    },
)
