"""slope_map_geo.tif: the map seen from above at its place on the earth, as bands of numbers of a GeoTIFF.

Source of the tags: "OGC GeoTIFF Standard" 1.1. Overviews are further images of the file, as GDAL writes them.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from slopecli.ground.slope_map import SlopeMap
from slopecli.patches.neighbours import nearest_by_tree
from slopecli.products.georeference import Georeference
from slopecli.products.map_tiff import NODATA, SOURCES, gdal_metadata, gdal_tags
from slopecli.products.region_mesh import FARTHEST
from slopecli.types import BoolArray, FloatArray, Image, IntArray


@dataclass(frozen=True)
class _Raster:
    """Tunables of the raster."""

    most_pixels: int = 1_000_000  # as of a megapixel image with a cell a pixel; a view along the ground is cut to that
    reach: float = 1.05  # of half the diagonal between cells: a pixel beyond belongs to no cell


class _GeoTag(IntEnum):
    """Numbers of the tags of GeoTIFF."""

    PIXEL_SCALE = 33550
    TIE_POINT = 33922
    KEY_DIRECTORY = 34735
    ASCII = 34737


class _GeoKey(IntEnum):
    """Numbers of the keys in its directory."""

    MODEL_TYPE = 1024
    RASTER_TYPE = 1025
    CITATION = 1026
    PROJECTION = 3072
    UNIT = 3076


RASTER = _Raster()


@dataclass(frozen=True, eq=False)
class Orthographic:
    """A raster, north of the grid up: left, top: its corner, m.  pixel_m : side of its square pixels.

    cell : (rows, columns) flat index of the map's cell whose ground is nearest to a pixel's middle; -1 for none.
    """

    left: float
    top: float
    pixel_m: float
    cell: IntArray


def encode(slope_map: SlopeMap, image: Image) -> bytes:
    """Return the content of slope_map_geo.tif."""
    return map_to_geotiff(slope_map)


def map_to_geotiff(slope_map: SlopeMap) -> bytes:
    """Serialise a map whose report is georeferenced as a GeoTIFF: the bands of slope_map.tif in a map projection.

    Tiled and deflated; every overview has every second row and column of the one before.
    """
    import tifffile

    place = Georeference.of(slope_map.report)
    raster = orthographic(slope_map, place)
    known, rows = raster.cell >= 0, np.maximum(raster.cell, 0)
    bands = np.array([getattr(slope_map, name).ravel()[rows] for name, _ in SOURCES.values()], np.float32)
    bands[~np.isfinite(bands) | ~known] = NODATA
    tags = [*gdal_tags(_metadata(slope_map, place)), *_geo_tags(raster, place)]
    content = io.BytesIO()
    with tifffile.TiffWriter(content, byteorder="<") as file:
        step = 1
        while step == 1 or max(bands.shape[1:]) > 128 * step:  # until it fits into half a tile
            file.write(
                np.ascontiguousarray(bands[:, ::step, ::step]),
                photometric="minisblack",
                planarconfig="separate",
                extrasamples=(0,) * (len(bands) - 1),
                tile=(256, 256),  # GDAL's own
                compression="zlib",
                subfiletype=0 if step == 1 else 1,
                metadata=None,  # neither a description nor a version of tifffile's own
                software=False,
                extratags=tags if step == 1 else gdal_tags(None),
            )
            step *= 2
    return content.getvalue()


def orthographic(slope_map: SlopeMap, place: Georeference) -> Orthographic:
    """Lay a raster over the ground of a map, and give every pixel the cell whose ground is nearest to it from above.

    The pixels are as large as the cells in the middle, of two figures, and their edges are at multiples of that.
    """
    known = slope_map.known & np.isfinite(slope_map.points).all(axis=2)
    away = np.linalg.norm(slope_map.points, axis=2)
    known &= away <= FARTHEST * float(np.median(away[known])) if known.any() else False
    ground = np.full((*known.shape, 2), np.nan)
    ground[known] = place.metres(slope_map.points[known])
    if not known.any():
        east0, north0 = place.metres(np.zeros((1, 3)))[0].tolist()
        return Orthographic(east0, north0, 1.0, np.full((1, 1), -1))
    reach, side = _cell_sizes(ground, known)
    low, high = np.nanmin(ground - reach[..., None], axis=(0, 1)), np.nanmax(ground + reach[..., None], axis=(0, 1))
    pixel = _two_figures(max(side, math.sqrt(float(np.prod(high - low)) / RASTER.most_pixels)))
    (left, bottom), (right, top) = np.floor(low / pixel) * pixel, np.ceil(high / pixel) * pixel
    columns, rows = round((right - left) / pixel), round((top - bottom) / pixel)
    east, north = left + (np.arange(columns) + 0.5) * pixel, top - (np.arange(rows) + 0.5) * pixel
    flat = np.flatnonzero(known)
    middles = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2) - low
    apart, nearest = (one[:, 0] for one in nearest_by_tree(ground.reshape(-1, 2)[flat] - low, middles, 1))
    within = apart <= np.maximum(reach.ravel()[flat][nearest], 0.5 * pixel)
    return Orthographic(float(left), float(top), pixel, np.where(within, flat[nearest], -1).reshape(rows, columns))


def _cell_sizes(ground: FloatArray, known: BoolArray) -> tuple[FloatArray, float]:
    """(rows, columns) how far the ground of a cell reaches from its middle, m, and the median side of a cell."""
    sides = []
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(ground, axis=axis), axis=2)
        missing = np.full([1 if k == axis else n for k, n in enumerate(known.shape)], np.nan)
        # of the two neighbours the nearer one: beyond a jump of the ground lies no ground of this cell
        sides.append(np.fmin(np.concatenate([step, missing], axis), np.concatenate([missing, step], axis)))
    one = np.where(np.isfinite(sides[0]), sides[0], sides[1])
    two = np.where(np.isfinite(sides[1]), sides[1], sides[0])
    side = np.sqrt(one * two)
    typical = float(np.median(side[np.isfinite(side)])) if np.isfinite(side).any() else 1.0
    reach = RASTER.reach * 0.5 * np.hypot(one, two)
    return np.where(known, np.where(np.isfinite(reach), reach, typical), np.nan), typical


def _two_figures(length: float) -> float:
    """A length, rounded up to two figures."""
    unit = 10.0 ** (math.floor(math.log10(length)) - 1)
    return float(f"{math.ceil(length / unit - 1e-9) * unit:.2g}")


def _geo_tags(raster: Orthographic, place: Georeference) -> list[tuple[Any, ...]]:
    """Corner, size of the pixels, and projection."""
    name = f"{place.projection}|"
    keys = [
        (1, 1, 1, 5),  # version, and how many keys follow: number, tag of the value or 0, its count, value or index
        _key(_GeoKey.MODEL_TYPE, 1),  # projected
        _key(_GeoKey.RASTER_TYPE, 1),  # a pixel is an area
        (_GeoKey.CITATION, _GeoTag.ASCII, len(name), 0),
        _key(_GeoKey.PROJECTION, place.epsg),
        _key(_GeoKey.UNIT, 9001),  # metre
    ]
    flat = [number for key in keys for number in key]
    return [
        (_GeoTag.PIXEL_SCALE, "d", 3, (raster.pixel_m, raster.pixel_m, 0.0), True),
        (_GeoTag.TIE_POINT, "d", 6, (0.0, 0.0, 0.0, raster.left, raster.top, 0.0), True),
        (_GeoTag.KEY_DIRECTORY, "H", len(flat), flat, True),
        (_GeoTag.ASCII, "s", 0, name, True),
    ]


def _key(number: int, value: int) -> tuple[int, int, int, int]:
    """The entry of a key whose value stands in the entry itself."""
    return number, 0, 1, value


def _metadata(slope_map: SlopeMap, place: Georeference) -> str:
    """Names and units of the bands, and how well the place is known."""
    points = slope_map.points[slope_map.known]
    sigma = place.sigma_m(points) if len(points) else np.array([place.position.sigma_m])
    here = place.position
    return gdal_metadata(
        slope_map.report.scale.unit,
        {
            "POSITION_SIGMA_M": f"{float(np.median(sigma)):.3g}",
            "POSITION_SIGMA_M_FARTHEST": f"{float(sigma.max()):.3g}",
            "CAMERA_LATITUDE_DEG": f"{here.latitude_deg:.8f}",
            "CAMERA_LONGITUDE_DEG": f"{here.longitude_deg:.8f}",
            "CAMERA_SIGMA_M": f"{here.sigma_m:.3g}",
            "ASPECT_FROM": "true north",
            "GRID_CONVERGENCE_DEG": f"{place.convergence_deg:.4f}",
            "UP_SOURCE": slope_map.report.up.source,
            "AMBIGUITY": slope_map.report.ambiguity.status,
        },
    )
