"""slope_map.tif: the map as bands of numbers, one cell a pixel."""

from __future__ import annotations

import io
from collections.abc import Mapping
from enum import IntEnum
from typing import Any

import numpy as np

from slopecli.ground.slope_map import SlopeMap
from slopecli.types import Image

MAP_FILE = "slope_map.tif"
NODATA = -9999.0
# name of a band -> the array of a `SlopeMap` and its unit, "" for that of the scale
SOURCES = {
    "slope_deg": ("slope_deg", "deg"),
    "slope_sigma_deg": ("sigma_deg", "deg"),
    "p_safe": ("p_safe", "1"),
    "aspect_deg": ("aspect_deg", "deg"),
    "roughness": ("roughness", ""),
    "above_plane_max": ("above_plane_max", ""),
    "below_plane_max": ("below_plane_max", ""),
    "distance": ("distance", ""),
    "valid_share": ("valid_share", "1"),
}
BANDS = tuple(SOURCES)


class _GdalTag(IntEnum):
    """Numbers of the tags that GDAL defines."""

    METADATA = 42112
    NODATA = 42113


def encode(slope_map: SlopeMap, image: Image) -> bytes:
    """Return the content of slope_map.tif."""
    return map_to_tiff(slope_map)


def map_to_tiff(slope_map: SlopeMap) -> bytes:
    """Serialise a map as a TIFF of float32 bands in the order of `BANDS`, `NODATA` where a number is not known.

    Bands have their names and units as GDAL writes them. There is no coordinate reference: pixels are cells of image 1,
    as the description in the file says. Not compressed, so that every reader opens it, and to the same bytes anywhere.
    """
    import tifffile

    planes = np.array([getattr(slope_map, source) for source, _ in SOURCES.values()], np.float32)
    planes[~np.isfinite(planes)] = NODATA
    content = io.BytesIO()
    with tifffile.TiffWriter(content, byteorder="<") as file:
        file.write(
            planes,
            photometric="minisblack",
            planarconfig="separate",
            extrasamples=(0,) * (len(BANDS) - 1),
            description=_description(slope_map.spacing_px),
            metadata=None,  # neither a description nor a version of tifffile's own
            software=False,
            extratags=gdal_tags(gdal_metadata(slope_map.report.scale.unit)),
        )
    return content.getvalue()


def _description(spacing_px: int) -> str:
    place = f"(u, v) = ((j + 0.5) * {spacing_px} - 0.5, (i + 0.5) * {spacing_px} - 0.5)"
    return f"slopemap: ground around every cell of image 1; row i, column j is centred at its pixel {place}"


def gdal_tags(metadata: str | None) -> list[tuple[Any, ...]]:
    """The tags of GDAL for tifffile: its XML, where there is some, and the value for what is not known."""
    nodata = (_GdalTag.NODATA, "s", 0, f"{NODATA:g}", True)
    return [nodata] if metadata is None else [(_GdalTag.METADATA, "s", 0, metadata, True), nodata]


def gdal_metadata(scale_unit: str, of_file: Mapping[str, str] | None = None) -> str:
    """Names and units of the bands in the XML of GDAL, and what is to be said of the whole file."""
    from html import escape  # that of xml.sax loads urllib and ssl

    items = [f'  <Item name="{name}">{escape(text, quote=False)}</Item>' for name, text in (of_file or {}).items()]
    for sample, (name, (_, unit)) in enumerate(SOURCES.items()):
        for item, role, text in (("DESCRIPTION", "description", name), ("UNITTYPE", "unittype", unit or scale_unit)):
            items.append(f'  <Item name="{item}" sample="{sample}" role="{role}">{escape(text, quote=False)}</Item>')
    return "\n".join(["<GDALMetadata>", *items, "</GDALMetadata>"]) + "\n"
