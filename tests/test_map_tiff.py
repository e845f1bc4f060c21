"""slope_map.tif: read back by other programs, with every band where it belongs."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import tifffile
from map_factory import make_map
from report_factory import make_report

from slopecli.ground import SlopeMap
from slopecli.products import BANDS, NODATA, map_to_tiff

UNITS = ("deg", "deg", "1", "deg", "m", "m", "m", "m", "1")


def some_map() -> SlopeMap:
    """A map whose bands all differ, 5 x 7 cells, with an unknown corner."""
    rng = np.random.default_rng(5)
    slope = rng.uniform(3, 30, (5, 7))
    slope[0, :2] = np.nan
    names = ("roughness", "above_plane_max", "below_plane_max", "valid_share")
    return make_map(slope, rng.uniform(0.1, 1, slope.shape), **{name: rng.uniform(0, 1, slope.shape) for name in names})


def expected_bands(slope_map: SlopeMap) -> np.ndarray:
    bands = np.array(
        [
            slope_map.slope_deg,
            slope_map.sigma_deg,
            slope_map.p_safe,
            slope_map.aspect_deg,
            slope_map.roughness,
            slope_map.above_plane_max,
            slope_map.below_plane_max,
            slope_map.distance,
            slope_map.valid_share,
        ]
    )
    return np.where(np.isfinite(bands), bands, NODATA).astype(np.float32)


def test_bands_are_those_of_the_map_in_their_order() -> None:
    slope_map = some_map()
    bands = tifffile.imread(io.BytesIO(map_to_tiff(slope_map)))
    assert bands.shape == (9, 5, 7)
    assert bands.dtype == np.float32
    np.testing.assert_array_equal(bands, expected_bands(slope_map))
    assert (bands[0] == NODATA).sum() == 2


def test_other_readers_see_the_same(tmp_path: Path) -> None:
    import skimage.io

    slope_map, path = some_map(), tmp_path / "slope_map.tif"
    path.write_bytes(map_to_tiff(slope_map))
    bands = skimage.io.imread(path)
    np.testing.assert_array_equal(np.moveaxis(bands, bands.shape.index(9), 0), expected_bands(slope_map))


@pytest.mark.parametrize(
    ("unit", "units"), [("m", UNITS), ("baseline", tuple(u.replace("m", "baseline") for u in UNITS))]
)
def test_bands_have_their_names_and_units(unit: str, units: tuple[str, ...]) -> None:
    slope_map = some_map()
    if unit == "baseline":
        slope_map = replace(slope_map, report=make_report())
    with tifffile.TiffFile(io.BytesIO(map_to_tiff(slope_map))) as file:
        tags = file.pages[0].tags
        assert len(file.pages) == 1
        items = ElementTree.fromstring(tags[42112].value)
        assert tags[42113].value == "-9999"
        assert "((j + 0.5) * 8 - 0.5, (i + 0.5) * 8 - 0.5)" in tags["ImageDescription"].value
        assert not {"Software", "DateTime", "GeoKeyDirectoryTag"} & {tag.name for tag in tags}
    told = {(item.get("role"), int(item.get("sample", -1))): item.text for item in items}
    assert tuple(told["description", k] for k in range(9)) == BANDS
    assert tuple(told["unittype", k] for k in range(9)) == units


def test_the_same_map_gives_the_same_bytes() -> None:
    assert map_to_tiff(some_map()) == map_to_tiff(some_map())


@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (9, 9), (3, 2)])
def test_maps_of_any_size_are_written(shape: tuple[int, int]) -> None:
    bands = tifffile.imread(io.BytesIO(map_to_tiff(make_map(np.full(shape, 4.0)))))
    assert bands.shape == (9, *shape)


@pytest.mark.skipif(shutil.which("gdalinfo") is None, reason="GDAL is not installed")
def test_gdal_knows_names_units_and_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "slope_map.tif"
    path.write_bytes(map_to_tiff(some_map()))
    done = subprocess.run(["gdalinfo", "-json", str(path)], capture_output=True, text=True, check=True)
    assert "warning" not in done.stderr.lower()
    told = json.loads(done.stdout)
    assert told["size"] == [7, 5]
    assert not told.get("coordinateSystem", {}).get("wkt")
    assert tuple(band["description"] for band in told["bands"]) == BANDS
    assert tuple(band["unit"] for band in told["bands"]) == UNITS
    assert {(band["type"], band["noDataValue"]) for band in told["bands"]} == {("Float32", NODATA)}
