"""Parts that the pictures share: canvas, colours, shapes, text and their placement."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "canvas": "LARGEST_PX SMALLEST_MAP_PX SMALLEST_PX",
        "colormap": "slope_colours",
        "label_text": "slope_text",
        "lettering": "text_width wrapped",
        "map_palette": "NO_REGION map_colours",
        "outlines": "Footprint downhill_px footprints_of",
        "placement": "Placed place_labels",
    },
)
