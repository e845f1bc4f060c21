"""labels.png: the plane id of every pixel of image 1 as a 16-bit PNG; 0 where there is no plane."""

from __future__ import annotations

from slopecli.products.drawing.png import encode_labels
from slopecli.types import Image, Report


def encode(report: Report, image: Image) -> bytes:
    """Return the content of labels.png."""
    return encode_labels(report.labels)
