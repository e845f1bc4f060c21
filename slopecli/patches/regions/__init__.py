"""The finder `regions`: planes found in the image, each with its pixels (Cheng, experiment 3)."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "block_labels": "BorderCost cheapest_labels enlarged",
        "cell_planes": "RegionCells region_cells",
        "merging": "Labelled merged refitted",
        "region_match": "match_labelled match_regions",
        "region_tunables": "REGION",
        "review": "reviewed",
    },
)
