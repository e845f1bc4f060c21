"""cloud.ply: read back by trimesh."""

from __future__ import annotations

import io

import numpy as np
import pytest
from map_factory import make_map, metric_report
from report_factory import make_report

from slopecli.ground import SlopeMap
from slopecli.products import map_to_ply
from slopecli.products.drawing import STEP_COLOUR, slope_classes


def some_map(rows: int = 60, columns: int = 80, **changes: object) -> SlopeMap:
    slope = np.random.default_rng(5).uniform(0.0, 40.0, (rows, columns))
    slope[:, :10] = np.nan
    return make_map(slope, 0.4, **changes)


def header_of(data: bytes) -> list[str]:
    return data.split(b"end_header\n")[0].decode("ascii").splitlines()


def vertices_of(data: bytes) -> np.ndarray:
    lines = header_of(data)
    types = {"float": "<f4", "uchar": "u1"}
    properties = [line.split()[1:] for line in lines if line.startswith("property ")]
    return np.frombuffer(data.split(b"end_header\n", 1)[1], [(name, types[kind]) for kind, name in properties])


def test_trimesh_reads_the_ground_of_known_cells() -> None:
    trimesh = pytest.importorskip("trimesh")
    slope_map = some_map()
    cloud = trimesh.load(io.BytesIO(map_to_ply(slope_map)), file_type="ply")
    known = slope_map.known
    right, down, ahead = slope_map.points[known].T  # a camera that looks straight down
    np.testing.assert_allclose(cloud.vertices, np.column_stack([right, -down, -ahead]), rtol=1e-6)
    classes = slope_classes(slope_map)
    assert np.array_equal(cloud.colors[:, :3], classes.colours[classes.of(slope_map.slope_deg[known])])


def test_every_point_has_its_numbers() -> None:
    slope_map = some_map()
    vertices = vertices_of(map_to_ply(slope_map))
    assert vertices.dtype.names == ("x", "y", "z", "red", "green", "blue", "slope_deg", "slope_sigma_deg", "p_safe")
    for name, values in (
        ("slope_deg", slope_map.slope_deg),
        ("slope_sigma_deg", slope_map.sigma_deg),
        ("p_safe", slope_map.p_safe),
    ):
        np.testing.assert_allclose(vertices[name], values[slope_map.known], rtol=1e-6, atol=1e-7)


def test_steps_have_a_colour_of_their_own() -> None:
    step = np.zeros((60, 80), bool)
    step[30:, 40:] = True
    vertices = vertices_of(map_to_ply(some_map(step=step)))
    dark = (np.column_stack([vertices[name] for name in ("red", "green", "blue")]) == STEP_COLOUR).all(axis=1)
    assert dark.sum() == 30 * 40


@pytest.mark.parametrize(("report", "unit"), [(metric_report(640, 480), "m"), (make_report(), "baseline")])
def test_the_header_says_frame_and_unit(report: object, unit: str) -> None:
    lines = header_of(map_to_ply(some_map(report=report)))
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert any(line.startswith("comment frame z up") for line in lines)
    assert sum(line.startswith("comment A") for line in lines) == 3
    assert f"comment unit {unit}" in lines


def test_large_maps_are_thinned_regularly() -> None:
    slope_map = some_map()
    whole = vertices_of(map_to_ply(slope_map))
    assert len(vertices_of(map_to_ply(slope_map, most_points=len(whole)))) == len(whole)
    few = vertices_of(map_to_ply(slope_map, most_points=700))
    assert 350 < len(few) <= 700
    kept = np.where(slope_map.known, slope_map.slope_deg, np.nan)[::3, ::3]
    np.testing.assert_allclose(few["slope_deg"], kept[np.isfinite(kept)], rtol=1e-6)


def test_a_map_without_known_ground_gives_an_empty_cloud() -> None:
    data = map_to_ply(make_map(np.full((4, 5), np.nan)))
    assert "element vertex 0" in header_of(data)
    assert len(vertices_of(data)) == 0
