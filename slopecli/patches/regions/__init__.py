"""The urban procedure: planes found in the image, each with the pixels that lie on it."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "block_labels": "BORDER BORDER_AT_EDGE BorderCost cheapest_labels enlarged",
        "cell_planes": "RegionCells region_cells",
        "merging": "Labelled merged refitted",
        "region_match": "CELL match_labelled match_regions",
        "review": "reviewed",
    },
)
