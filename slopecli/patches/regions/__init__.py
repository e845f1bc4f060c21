"""The finder `regions`: planes found in the image, each with its pixels (Cheng, experiment 3)."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "blank_planes": "find_blank_planes",
        "block_labels": "BorderCost cheapest_labels enlarged label_cells",
        "borders": "with_pixel_borders",
        "cell_lattice": "CellLattice lattice_of",
        "common_planes": "find_common_planes",
        "merging": "merged",
        "plane_pieces": "KnownTilt Piece fewest_pieces grown_pieces",
        "region_finder": "RegionStages region_stages",
        "region_match": "match_labelled match_regions on_known_orientation",
        "region_tunables": "REGION",
        "swept_cells": "with_swept_cells",
    },
)
