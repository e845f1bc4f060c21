"""A finished answer against known ground: a plane of the truth under every patch (the paper's Figures 8 and 9)."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "comparison": "CellsCompared Comparison PatchCompared compare fit_plane summary_lines",
        "finished_result": "Result ResultPlane",
        "truth": "Truth from_depth from_disparity from_points",
    },
)
