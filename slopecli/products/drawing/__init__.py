"""Parts that the pictures share: canvas, colours, shapes, text and their placement."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "canvas": "LARGEST_PX SMALLEST_MAP_PX SMALLEST_PX",
        "colours": "NO_REGION map_colours slope_colours",
        "lettering": "slope_text text_width wrapped",
        "outlines": "Footprint downhill_px footprints_of",
        "placement": "Placed place_labels",
    },
)
