"""Files for a GIS: the map, planes and sites at their place on the earth, as GDAL and independent formulas have it."""

from __future__ import annotations

import csv
import io
import json
import math
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import tifffile
from map_factory import make_map, make_site, metric_report
from pyproj import Geod, Proj
from report_factory import make_camera, make_image, make_plane, make_report, rectangle
from scipy.ndimage import binary_fill_holes
from solution_factory import make_report_of, make_solution

from slopecli.ground import SlopeMap
from slopecli.options import Options, Place, Position
from slopecli.products import (
    BANDS,
    MAP_PRODUCTS,
    NODATA,
    PRODUCTS,
    Georeference,
    encode_products,
    map_to_geotiff,
    map_to_qml,
    measures_of,
    orthographic,
    polygons_to_qml,
    report_to_csv,
)
from slopecli.products.drawing import slope_classes
from slopecli.types import Report, Scale, Up

HERE = Position(46.5763, 8.0158, 1600.0, 2.0, 4.0, 2.0)
GEOD = Geod(ellps="WGS84")
GDAL = pytest.mark.skipif(shutil.which("gdalinfo") is None, reason="GDAL is not installed")


def place(
    north: tuple[float, float, float] = (0.0, -1.0, 0.0), position: Position = HERE, sigma_deg: float = 1.0
) -> Place:
    return Place(position, north, 0.0, sigma_deg)


def placed(report: Report, **changes: Any) -> Report:
    return replace(report, **{"place": place(), "scale": Scale("m", "baseline", 0.01), **changes})


def placed_map(slope: np.ndarray, **changes: Any) -> SlopeMap:
    rows, columns = slope.shape
    report = placed(metric_report(columns * 8, rows * 8), **changes.pop("of_report", {}))
    return make_map(slope, report=report, **changes)


def towards(position: Position, east_m: float, north_m: float) -> tuple[float, float]:
    """Longitude and latitude of a place a few metres away, by the geodesic."""
    azimuth, length = math.degrees(math.atan2(east_m, north_m)), math.hypot(east_m, north_m)
    longitude, latitude, _ = GEOD.fwd(position.longitude_deg, position.latitude_deg, azimuth, length)
    return longitude, latitude


# ---- where a point is ----


@pytest.mark.parametrize("heading_deg", [0.0, 37.0, 200.0])
@pytest.mark.parametrize("position", [HERE, Position(-33.9, 151.2, None, 1.0, 2.0, 1.0)])
def test_points_are_where_the_geodesic_leads(heading_deg: float, position: Position) -> None:
    """A camera that looks straight down, its image's up towards the heading: north is turned the other way."""
    turn = math.radians(heading_deg)
    north = (-math.sin(turn), -math.cos(turn), 0.0)
    reference = Georeference.of(placed(make_report(), place=place(north, position)))
    points = np.array([[0.0, 0.0, 50.0], [30.0, -40.0, 50.0], [-7.0, 12.0, 60.0]])
    for (x, y, _), found in zip(points, reference.degrees(points), strict=True):
        east = x * math.cos(turn) - y * math.sin(turn)
        away = -x * math.sin(turn) - y * math.cos(turn)
        longitude, latitude = towards(position, east, away)
        _, _, off = GEOD.inv(longitude, latitude, *found)
        assert off < 0.02  # m; on the ellipsoid, camera 1 is 1600 m above: 50 m there are 49.99 m here


@pytest.mark.parametrize(
    ("latitude", "longitude", "epsg", "name"),
    [
        (46.6, 8.0, 32632, "WGS 84 / UTM zone 32N"),
        (-33.9, 151.2, 32756, "WGS 84 / UTM zone 56S"),
        (0.1, -180.0, 32601, "WGS 84 / UTM zone 1N"),
        (0.1, 180.0, 32601, "WGS 84 / UTM zone 1N"),
        (85.0, 12.0, 32661, "WGS 84 / UPS North (N,E)"),
        (-88.0, 12.0, 32761, "WGS 84 / UPS South (N,E)"),
    ],
)
def test_projections(latitude: float, longitude: float, epsg: int, name: str) -> None:
    position = Position(latitude, longitude, 0.0, 1.0, 1.0, 1.0)
    reference = Georeference.of(placed(make_report(), place=place(position=position)))
    assert (reference.epsg, reference.projection) == (epsg, name)
    projection = Proj(f"EPSG:{epsg}")
    assert reference.metres(np.zeros((1, 3)))[0] == pytest.approx(projection(longitude, latitude), abs=1e-4)
    factors = projection.get_factors(longitude, latitude)
    if epsg not in (32661, 32761):
        assert reference.convergence_deg == pytest.approx(factors.meridian_convergence, abs=1e-3)


def test_a_marked_corner_is_within_its_stated_sigma() -> None:
    """Errors of place, heading, up and scale drawn with their sigmas: the corner of the map is off by as much."""
    rng, ratios = np.random.default_rng(3), []
    slope, marked = np.full((12, 16), 4.0), (slice(0, 3), slice(13, 16))
    cells = np.arange(12 * 16).reshape(12, 16)[marked]
    truth = placed_map(slope, of_report={"place": place(sigma_deg=0.0), "scale": Scale("m", "baseline", 0.0)})
    corner = Georeference.of(truth.report).degrees(truth.points[marked].mean(axis=(0, 1))[None])[0]
    for _ in range(100):
        north_m, east_m = HERE.sigma_m * rng.standard_normal(2)
        longitude, latitude = towards(HERE, east_m, north_m)
        turn, (lean_x, lean_y) = np.radians(8.0 * rng.standard_normal()), np.radians(3.0 * rng.standard_normal(2))
        seen = placed_map(
            slope,
            of_report={
                "place": place(
                    (math.sin(turn), -math.cos(turn), 0.0),
                    replace(HERE, latitude_deg=latitude, longitude_deg=longitude),
                    8.0,
                ),
                "up": Up((lean_x, lean_y, -1.0), "given", 3.0),
                "scale": Scale("m", "baseline", 0.1),
            },
        )
        seen = replace(seen, points=seen.points * (1.0 + 0.1 * rng.standard_normal()))
        reference = Georeference.of(seen.report)
        raster = orthographic(seen, reference)
        rows, columns = np.nonzero(np.isin(raster.cell, cells))
        easting = raster.left + (columns.mean() + 0.5) * raster.pixel_m
        northing = raster.top - (rows.mean() + 0.5) * raster.pixel_m
        found = Proj(f"EPSG:{reference.epsg}")(easting, northing, inverse=True)
        azimuth, _, off = GEOD.inv(*corner, *found)
        sigma = float(reference.sigma_m(seen.points[marked].mean(axis=(0, 1))[None])[0])
        ratios += [off * math.sin(math.radians(azimuth)) / sigma, off * math.cos(math.radians(azimuth)) / sigma]
    assert 0.8 < float(np.sqrt(np.mean(np.square(ratios)))) < 1.2
    assert np.mean(np.abs(ratios) < 2.0) > 0.9


def test_sigma_grows_with_the_distance_and_says_what_it_is_made_of() -> None:
    report = placed(make_report(), up=Up((0.0, 0.0, -1.0), "given", 1.0), scale=Scale("m", "baseline", 0.02))
    below, aside = Georeference.of(report).sigma_m(np.array([[0.0, 0.0, 100.0], [300.0, 0.0, 100.0]]))
    leaning = 100.0 * math.radians(1.0)
    assert below == pytest.approx(math.hypot(2.0, leaning))
    assert aside == pytest.approx(math.sqrt(4.0 + leaning**2 + (300.0 * 0.02) ** 2))


# ---- slope_map_geo.tif ----


def pixel_at(slope_map: SlopeMap, cell: tuple[int, int]) -> tuple[int, int]:
    """Row and column of the pixel of slope_map_geo.tif over the ground of a cell, by pyproj alone."""
    raster = orthographic(slope_map, Georeference.of(slope_map.report))
    east, north = np.array([1.0, -1.0]) * slope_map.points[cell][:2]  # the image's up is north
    easting, northing = Proj("EPSG:32632")(*towards(HERE, east, north))
    return int((raster.top - northing) / raster.pixel_m), int((easting - raster.left) / raster.pixel_m)


def test_every_cell_lies_where_its_ground_is() -> None:
    rng = np.random.default_rng(1)
    slope = rng.uniform(1, 30, (30, 40))
    slope[10:14, 20:26] = np.nan
    slope_map = placed_map(slope)
    bands = tifffile.imread(io.BytesIO(map_to_geotiff(slope_map)), key=0)
    for cell in ((0, 0), (0, 39), (29, 0), (29, 39), (15, 20), (9, 19)):
        row, column = pixel_at(slope_map, cell)
        around = bands[0, max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        assert np.isclose(around, slope[cell], atol=1e-5).any()
    beside = np.mean([pixel_at(slope_map, (12, 18)), pixel_at(slope_map, (12, 27))], axis=0).astype(int)
    assert bands[0][tuple(beside)] == NODATA
    shown = np.unique(bands[0][bands[0] != NODATA])
    assert set(np.round(shown, 4)) <= set(np.round(slope[np.isfinite(slope)].astype(np.float32), 4))
    assert len(shown) > 0.9 * np.isfinite(slope).sum()


def test_a_hillside_seen_askance_lies_where_it_is_from_above() -> None:
    """A camera at 45 degrees: the far cells are far apart on the ground, and the raster has no holes between them."""
    slope_map = placed_map(np.full((30, 40), 5.0), of_report={"up": Up((0.0, -1.0, -1.0), "given", 0.5)})
    raster = orthographic(slope_map, Georeference.of(slope_map.report))
    filled = raster.cell >= 0
    assert filled.mean() > 0.3
    assert (binary_fill_holes(filled) != filled).sum() < 0.01 * filled.sum()


def test_ground_beyond_a_step_is_not_joined_by_what_nobody_saw() -> None:
    """The right half lies ten times as deep: what is between the two from above stays empty."""
    slope_map = placed_map(np.full((20, 20), 5.0))
    points = slope_map.points.copy()
    points[:, 10:] *= 3.0
    raster = orthographic(replace(slope_map, points=points), Georeference.of(slope_map.report))
    assert (raster.cell >= 0).mean() < 0.75
    assert set(np.unique(raster.cell[raster.cell >= 0])) <= set(range(400))


@pytest.mark.parametrize("slope", [np.full((1, 1), 3.0), np.full((9, 9), np.nan), np.full((1, 30), 3.0)])
def test_maps_of_any_kind_are_written(slope: np.ndarray) -> None:
    bands = tifffile.imread(io.BytesIO(map_to_geotiff(placed_map(slope))), key=0)
    assert (bands[0] != NODATA).any() == np.isfinite(slope).any()


def test_the_same_map_gives_the_same_bytes() -> None:
    slope = np.random.default_rng(2).uniform(0, 30, (30, 40))
    assert map_to_geotiff(placed_map(slope)) == map_to_geotiff(placed_map(slope))


@GDAL
def test_gdal_finds_place_names_units_nodata_and_overviews(tmp_path: Path) -> None:
    slope_map = placed_map(np.random.default_rng(2).uniform(0, 30, (200, 300)))
    path = tmp_path / "slope_map_geo.tif"
    path.write_bytes(map_to_geotiff(slope_map))
    done = subprocess.run(["gdalinfo", "-json", "-stats", str(path)], capture_output=True, text=True, check=True)
    assert "warning" not in done.stderr.lower()
    told = json.loads(done.stdout)
    assert 'ID["EPSG",32632]' in told["coordinateSystem"]["wkt"]
    assert tuple(band["description"] for band in told["bands"]) == BANDS
    assert [band["unit"] for band in told["bands"]] == ["deg", "deg", "1", "deg", "m", "m", "m", "m", "1"]
    assert {(band["type"], band["noDataValue"]) for band in told["bands"]} == {("Float32", NODATA)}
    assert {tuple(band["block"]) for band in told["bands"]} == {(256, 256)}
    sizes = [tuple(one["size"]) for one in told["bands"][0]["overviews"]]
    width, height = told["size"]
    assert sizes[0] == (-(-width // 2), -(-height // 2))
    assert max(sizes[-1]) <= 256
    assert told["metadata"]["IMAGE_STRUCTURE"]["COMPRESSION"] == "DEFLATE"
    sigmas = [float(told["metadata"][""][name]) for name in ("POSITION_SIGMA_M", "POSITION_SIGMA_M_FARTHEST")]
    assert 2.0 < sigmas[0] < sigmas[1] < 3.0
    assert told["metadata"][""]["ASPECT_FROM"] == "true north"
    ring = np.array(told["wgs84Extent"]["coordinates"][0])
    assert (ring.min(axis=0) < (HERE.longitude_deg, HERE.latitude_deg)).all()
    assert (ring.max(axis=0) > (HERE.longitude_deg, HERE.latitude_deg)).all()
    assert 0.0 <= told["bands"][0]["minimum"] <= told["bands"][0]["maximum"] <= 30.0


# ---- slopes.geojson ----


def features(content: bytes) -> list[dict[str, Any]]:
    document = json.loads(content)
    assert document["type"] == "FeatureCollection"
    assert "crs" not in document
    return list(document["features"])


def geojson_of(answer: Report | SlopeMap) -> bytes:
    """The content of slopes.geojson of a report or a map."""
    rows = MAP_PRODUCTS if isinstance(answer, SlopeMap) else PRODUCTS
    (content,) = encode_products(
        answer, make_image(), frozenset(), [one for one in rows if one.file == "slopes.geojson"]
    ).values()
    return content


def rings_of(geometry: dict[str, Any]) -> list[np.ndarray]:
    polygons = [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]
    return [np.array(polygon[0]) for polygon in polygons]


def area_deg2(ring: np.ndarray) -> float:
    x, y = (ring - ring[0]).T
    return float(x[:-1] @ y[1:] - x[1:] @ y[:-1]) / 2.0


def test_windows_and_sites_are_polygons_on_the_earth() -> None:
    report = placed(make_report())
    slope_map = make_map(np.full((60, 80), 4.0), report=report, sites=(make_site(1, (320.0, 240.0), 40.0),))
    found = features(geojson_of(slope_map))
    assert [feature["id"] for feature in found] == [*(f"window {k}" for k in range(1, 9)), "site 1"]
    for feature in found:
        (ring,) = rings_of(feature["geometry"])
        assert (ring[0] == ring[-1]).all()
        assert area_deg2(ring) > 0.0  # counter-clockwise, as RFC 7946 asks
        assert np.abs(ring - (HERE.longitude_deg, HERE.latitude_deg)).max() < 0.01
        assert feature["properties"]["position_sigma_m"] >= HERE.sigma_m
    (ring,) = rings_of(found[-1]["geometry"])
    away = [GEOD.inv(*ring[:-1].mean(axis=0), *corner)[2] for corner in ring]
    assert away == pytest.approx([2.0] * len(away), abs=0.01)
    assert found[0]["properties"]["verdict"] == report.planes[0].verdict


def test_a_window_covers_the_ground_that_it_shows() -> None:
    """Level ground 100 m below: the window's corner is as far east and south as its pixel says."""
    camera = make_camera()
    plane = make_plane(1, rectangle(400.0, 300.0, 100.0, 80.0), 0.0, camera=camera)
    plane = replace(plane, distance=100.0)
    report = placed(make_report(camera, []), planes=(plane,))
    (feature,) = features(geojson_of(report))
    (ring,) = rings_of(feature["geometry"])
    corner = ((400.0 - camera.cx) / camera.fx * 100.0, -(300.0 - camera.cy) / camera.fy * 100.0)
    wanted = towards(HERE, *corner)
    assert min(GEOD.inv(*wanted, *one)[2] for one in ring) < 0.03
    side = 100.0 * 100.0 / camera.fx
    assert feature["properties"]["area_m2"] == pytest.approx(side * 0.8 * side)


def test_a_polygon_across_the_date_line_is_cut() -> None:
    position = Position(-17.0, 179.99999, 0.0, 1.0, 2.0, 1.0)
    plane = replace(make_plane(1, rectangle(200.0, 150.0, 240.0, 180.0), 0.0), distance=100.0)
    report = placed(make_report(make_camera(), []), planes=(plane,), place=place(position=position))
    (feature,) = features(geojson_of(report))
    assert feature["geometry"]["type"] == "MultiPolygon"
    west, east = rings_of(feature["geometry"])
    assert west[:, 0].min() > 179.9
    assert west[:, 0].max() <= 180.0
    assert east[:, 0].min() >= -180.0
    assert east[:, 0].max() < -179.9
    assert area_deg2(west) > 0.0 < area_deg2(east)


def test_a_window_that_shows_no_ground_has_no_polygon() -> None:
    """Above the horizon of its plane, whose table then has no area either."""
    camera = make_camera()
    wall = replace(make_plane(1, rectangle(0.0, 0.0, 640.0, 200.0), 30.0), normal_cam1=np.array([0.0, -1.0, 0.0]))
    report = placed(make_report(camera, []), planes=(wall,))
    assert features(geojson_of(report)) == []
    assert measures_of(wall, report).area is None


# ---- slope_map.qml ----


def test_the_style_has_the_classes_and_colours_of_the_picture() -> None:
    slope_map = placed_map(np.full((6, 8), 4.0), classes_deg=(4.0, 12.0))
    classes = slope_classes(slope_map)
    items = ElementTree.fromstring(map_to_qml(slope_map)).findall(".//item")
    assert [item.get("value") for item in items] == [*(f"{edge:g}" for edge in classes.edges_deg), "inf"]
    assert [item.get("label") for item in items] == classes.names
    assert [item.get("color") for item in items] == [
        "#" + bytes(colour).hex() for colour in classes.colours.astype(np.uint8).tolist()
    ]


def test_the_style_of_polygons_has_a_line_for_every_verdict_and_fills_none() -> None:
    style = ElementTree.fromstring(polygons_to_qml())
    symbols = {symbol.get("name"): symbol for symbol in style.findall(".//symbol")}
    assert [one.get("value") for one in style.findall(".//category")] == ["safe", "undecided", "unsafe", ""]
    colours = set()
    for category in style.findall(".//category"):
        layers = symbols[category.get("symbol")].findall("layer")
        assert [layer.get("class") for layer in layers] == ["SimpleLine", "SimpleLine"]
        colour = layers[1].find("Option/Option[@name='line_color']")
        assert colour is not None
        colours.add(colour.get("value"))
    assert len(colours) == 4


# ---- planes.csv ----


def rows_of(report: Report) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(report_to_csv(report))))


def test_tilt_in_the_words_of_every_trade() -> None:
    plane = replace(make_plane(1, rectangle(300.0, 200.0, 40.0, 40.0), 45.0, azimuth_deg=60.0), distance=2.0)
    (row,) = rows_of(make_report(make_camera(), [], planes=(plane,)))
    numbers = {name: float(row[name]) for name in ("slope_deg", "slope_percent", "slope_in_12", "dip_deg")}
    assert numbers == pytest.approx({"slope_deg": 45, "slope_percent": 100, "slope_in_12": 12, "dip_deg": 45}, rel=1e-5)
    # dips to the east-north-east: facing along the strike, the descent is to the right
    assert (float(row["dip_direction_deg"]), float(row["strike_deg"])) == (60.0, 330.0)
    assert (row["area_unit"], row["verdict"], row["longitude_deg"]) == ("baseline2", "unsafe", "")


def test_walls_overhangs_level_ground_and_unknown_slopes_leave_cells_empty() -> None:
    outline = rectangle(300.0, 200.0, 40.0, 40.0)
    overhang = make_plane(2, outline, 100.0, aspect_deg=60.0, dip_direction_deg=240.0)
    level = make_plane(3, outline, 0.2)
    unknown = make_plane(4, outline, 20.0, 12.0, slope_known=False, status="poor")
    report = make_report(make_camera(), [], planes=(overhang, level, unknown))
    one, two, three = rows_of(report)
    assert (one["slope_percent"], one["slope_in_12"], one["dip_deg"]) == ("", "", "80")
    assert (one["aspect_deg"], one["dip_direction_deg"], one["strike_deg"]) == ("60", "240", "150")
    assert (two["aspect_deg"], two["strike_deg"], two["dip_deg"]) == ("", "", "0.2")
    assert (three["slope_deg"], three["slope_sigma_deg"], three["status"]) == ("", "12", "poor")


def test_strike_is_as_sure_as_the_plane_is_steep() -> None:
    """In every file alike; a plane that may be level has neither strike nor sigma."""
    options = Options(north=(0.0, -1.0, 0.0), north_sigma_deg=0.3, position=HERE, baseline_m=3.0)
    report = make_report_of(make_solution([60.0, 10.0, 1.0], [0.4, 0.4, 0.6]), options)
    rows = rows_of(report)
    sigmas = [math.hypot(0.4 / math.sin(math.radians(slope)), 0.3) for slope in (60.0, 10.0)]
    assert [float(row["azimuth_sigma_deg"]) for row in rows[:2]] == pytest.approx(sigmas, rel=0.01)
    assert (rows[2]["strike_deg"], rows[2]["azimuth_sigma_deg"]) == ("", "")
    for document in (
        [one["properties"] for one in features(geojson_of(report))],
        json.loads(report.to_json())["planes"],
    ):
        assert [one["azimuth_sigma_deg"] for one in document[:2]] == pytest.approx(sigmas, rel=0.01)
        assert document[2]["azimuth_sigma_deg"] is None


@pytest.mark.parametrize("slope_deg", [80.0, 89.9])
def test_walls_have_no_percent(slope_deg: float) -> None:
    plane = make_plane(1, rectangle(300.0, 200.0, 40.0, 40.0), slope_deg)
    (row,) = rows_of(make_report(make_camera(), [], planes=(plane,)))
    assert (row["slope_percent"], row["slope_in_12"], float(row["dip_deg"])) == ("", "", slope_deg)


@pytest.mark.parametrize("slope_deg", [0.0, 30.0])
def test_area_of_pixels_is_that_of_the_outline(slope_deg: float) -> None:
    """A region that fills a rectangle has the area of a window of that rectangle; lens distortion included."""
    camera = make_camera(model="brown", distortion=(-0.05, 0.01))
    corners = np.array([[199.5, 149.5], [259.5, 149.5], [259.5, 199.5], [199.5, 199.5]])
    window = make_plane(1, corners, slope_deg, camera=camera)
    region = make_plane(1, corners, slope_deg, camera=camera, source="region")
    labels = np.zeros((480, 640), np.uint16)
    labels[150:200, 200:260] = 1
    report = make_report(camera, [], planes=(window,), labels=labels)
    assert measures_of(region, report).area == pytest.approx(measures_of(window, report).area, rel=1e-3)


def test_a_placed_table_has_longitude_and_latitude() -> None:
    plane = replace(make_plane(1, rectangle(300.0, 200.0, 40.0, 40.0), 0.0), distance=100.0)
    (row,) = rows_of(placed(make_report(make_camera(), []), planes=(plane,)))
    assert float(row["latitude_deg"]) == pytest.approx(HERE.latitude_deg, abs=1e-3)
    assert float(row["position_sigma_m"]) >= 2.0
    assert row["area_unit"] == "m2"


# ---- which files there are ----


def test_without_a_place_or_metres_there_is_no_file_of_a_gis() -> None:
    placed_names = {"slopes.geojson", "slopes.qml", "slope_map_geo.tif", "slope_map_geo.qml"}
    for changes in ({"place": None}, {"place": Place(HERE)}, {"place": place(position=None)}, {"scale": Scale()}):
        report = placed(make_report(), **changes)
        slope_map = make_map(np.full((6, 8), 4.0), report=report)
        made = {one.file for one in PRODUCTS if one.is_made(report, frozenset())}
        made |= {one.file for one in MAP_PRODUCTS if one.is_made(slope_map, frozenset())}
        assert not placed_names & made
        assert {"planes.csv", "slope_map.tif", "slope_map.qml"} <= made
    assert {product.file for product in (*PRODUCTS, *MAP_PRODUCTS) if product.requires == "place"} == placed_names
