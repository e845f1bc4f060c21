"""Parts that the pictures share: canvas, colours, shapes, text and their placement."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "canvas": "LARGEST_PX SMALLEST_MAP_PX SMALLEST_PX",
        "colormap": "slope_colours",
        "lettering": "text_width wrapped",
        "map_palette": "NO_REGION map_colours",
        "outlines": "Footprint downhill_px footprints_of",
        "placement": "Placed place_labels slope_text",
        "region_numbers": "place_region_labels",
    },
)
