"""Parts that the pictures share: canvas, colours, shapes, text and their placement."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "canvas": "LONG_SIDE_PX map_frame",
        "cell_shares": "cell_area_m2 share_text",
        "classes": "STEP STEP_COLOUR UNKNOWN cell_classes lightness_of sigma_classes slope_classes",
        "colours": "NO_REGION map_colours slope_colours",
        "ground_marks": "bar_length_m north_px spread",
        "lettering": "slope_text text_width wrapped",
        "outlines": "Footprint downhill_px footprints_of",
        "placement": "Placed place_labels",
    },
)
