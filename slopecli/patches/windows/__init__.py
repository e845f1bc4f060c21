"""The windows finder: rectangles of image 1 given by the user, each matched by itself."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "matching": "match_window",
        "unmatched_parts": "bend_rad beside_rad contradict gaps_of stepped_rad unseen_rad",
        "window_finder": "window_patch",
    },
)
