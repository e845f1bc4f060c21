"""cloud.ply: the ground in the middle of every known cell of a map, in the colour of its class of slope."""

from __future__ import annotations

import math

import numpy as np

from slopecli import __version__
from slopecli.ground.slope_map import SlopeMap
from slopecli.products.drawing.classes import STEP_COLOUR, cell_classes, slope_classes
from slopecli.products.model_frame import frame_comments, model_rotation
from slopecli.products.region_mesh import MOST_TRIANGLES
from slopecli.types import BoolArray, Image

MOST_POINTS = MOST_TRIANGLES  # as many are opened at once by any viewer
VERTEX = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z")]
    + [(name, "u1") for name in ("red", "green", "blue")]
    + [(name, "<f4") for name in ("slope_deg", "slope_sigma_deg", "p_safe")]
)
_TYPE_NAMES = {"<f4": "float", "|u1": "uchar"}


def encode(slope_map: SlopeMap, image: Image) -> bytes:
    """Return the content of cloud.ply."""
    return map_to_ply(slope_map)


def map_to_ply(slope_map: SlopeMap, most_points: int = MOST_POINTS) -> bytes:
    """Serialise the ground of known cells as the points of a binary PLY file, in reading order.

    Source: Turk, "The PLY Polygon File Format", 1994.

    Parameters
    ----------
    most_points : where there are more, only every k-th row and column is written.
    """
    known = slope_map.known & np.isfinite(slope_map.points).all(axis=2)
    step = _stride(known, most_points)
    rows, columns = np.nonzero(known[::step, ::step])
    cell = rows * step, columns * step
    classes = slope_classes(slope_map)
    palette = np.vstack([classes.colours, [STEP_COLOUR, (0, 0, 0)]])  # -2 is a step
    vertices = np.zeros(len(rows), VERTEX)
    for names, values in (
        ("x y z", slope_map.points[cell] @ model_rotation(slope_map.report).T),
        ("red green blue", palette[cell_classes(slope_map, classes)[cell]]),
        ("slope_deg", slope_map.slope_deg[cell][:, None]),
        ("slope_sigma_deg", slope_map.sigma_deg[cell][:, None]),
        ("p_safe", slope_map.p_safe[cell][:, None]),
    ):
        for name, column in zip(names.split(), values.T, strict=True):
            vertices[name] = column
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment slopemap {__version__}",
        *(f"comment {line}" for line in frame_comments(slope_map.report)),
        f"comment unit {slope_map.report.scale.unit}",
        f"comment every cell of {slope_map.spacing_px * step} px of image 1 whose slope is known",
        f"element vertex {len(vertices)}",
        *(f"property {_TYPE_NAMES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()),
        "end_header",
    ]
    return "\n".join(header).encode("ascii") + b"\n" + vertices.tobytes()


def _stride(known: BoolArray, most: int) -> int:
    """Smallest step over rows and columns that leaves at most so many cells."""
    stride = max(1, math.isqrt(max(0, int(known.sum()) - 1) // most))
    while known[::stride, ::stride].sum() > most:
        stride += 1
    return stride
