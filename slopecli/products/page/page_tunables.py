"""Sizes of what is on the page."""

from __future__ import annotations

from typing import NamedTuple


class PageTunables(NamedTuple):
    """How much a page shows, so that it stays small and is opened at once."""

    most_rows: int = 250  # of a table; slopes.json has them all
    most_whys: int = 60  # planes whose sigma is explained
    model_triangles: int = 12_000  # half a megabyte with the viewer; patches.glb has more
    jpeg_quality: int = 88


PAGE = PageTunables()
