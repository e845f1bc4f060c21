"""patches.ply: read back by an independent parser, and by trimesh where it is installed."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from report_factory import (
    BASELINE,
    make_ambiguity,
    make_camera,
    make_image,
    make_plane,
    make_region_report,
    make_report,
    normal_of,
    rectangle,
)

from slopecli.geometry import pixels_from_rays
from slopecli.products import planes_mesh, region_surfaces, report_to_ply
from slopecli.products.drawing import slope_colours
from slopecli.types import Camera, Image, Motion, Report, Scale, Up

DISTORTED = Camera(640, 480, 420.0, 421.0, 318.0, 242.0, "brown", (-0.28, 0.07, 2e-4, -1e-4))
PROPERTIES = (
    "float x|float y|float z|float nx|float ny|float nz|uchar red|uchar green|uchar blue|float quality|"
    "float scalar_slope_deg|float scalar_sigma_slope_deg|float scalar_patch_id"
)


def parse(data: bytes) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Header lines, vertices in camera-1 axes as a table of doubles in the order of `PROPERTIES`, triangles; strict."""
    head, body = data.split(b"end_header\n", 1)
    lines = head.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    words = [line for line in lines[2:] if not line.startswith("comment ")]
    n, m = int(words[0].removeprefix("element vertex ")), int(words[14].removeprefix("element face "))
    assert words[1:14] == [f"property {name}" for name in PROPERTIES.split("|")]
    assert words[15:] == ["property list uchar int vertex_indices"]
    vertex = np.dtype([(p, "<f4" if p.startswith("float") else "u1") for p in PROPERTIES.split("|")])
    face = np.dtype([("n", "u1"), ("i", "<i4", 3)])
    assert len(body) == n * vertex.itemsize + m * face.itemsize
    table = np.frombuffer(body, vertex, n)
    faces = np.frombuffer(body, face, m, n * vertex.itemsize)
    assert (faces["n"] == 3).all()
    assert faces["i"].min() >= 0
    assert faces["i"].max() < n
    columns = np.column_stack([table[name].astype(float) for name in table.dtype.names])
    assert np.isfinite(columns).all()
    if rows := re.findall(r"^comment A\d (.*)$", "\n".join(lines), re.MULTILINE):
        back = np.array([[float(value) for value in row.split()] for row in rows])
        columns[:, :3], columns[:, 3:6] = columns[:, :3] @ back, columns[:, 3:6] @ back
    return lines, columns, faces["i"]


def test_a_slope_that_is_not_known_gives_no_colour_and_no_value() -> None:
    report = make_report()
    vague = replace(report.planes[1], slope_known=False, slope_sigma_deg=24.0)
    _, columns, faces = parse(report_to_ply(replace(report, planes=(report.planes[0], vague))))
    here, _ = of_patch(columns, faces, vague.id)
    assert np.ptp(here[:, 6:9]) == 0  # grey
    assert set(here[:, 9]) == set(here[:, 10]) == {-1.0}
    assert set(here[:, 11]) == {24.0}


def test_a_second_answer_is_named_in_the_header() -> None:
    report = make_report()
    lines, *_ = parse(report_to_ply(replace(report, ambiguity=make_ambiguity(report))))
    assert "comment two answers: this is the first, a second one fits as well" in lines
    assert "comment patch 2 in the second answer: slope 32.00 deg, 1-sigma 0.70 deg" in lines
    assert sum("second answer" in line for line in lines) == len(report.planes)
    assert not any("answer" in line for line in parse(report_to_ply(report))[0])


def of_patch(columns: np.ndarray, triangles: np.ndarray, patch_id: int) -> tuple[np.ndarray, np.ndarray]:
    return columns[columns[:, 12] == patch_id], triangles[(columns[triangles[:, 0], 12] == patch_id)]


def doubled_area(corners: np.ndarray) -> np.ndarray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def polygon_area(polygon: np.ndarray) -> float:
    u, v = polygon.T
    return 0.5 * abs(float(u @ np.roll(v, -1) - v @ np.roll(u, -1)))


@pytest.mark.parametrize("camera", [make_camera(), DISTORTED], ids=["pinhole", "distorted"])
def test_patches_lie_on_their_planes_under_their_windows(camera: Camera) -> None:
    report = make_report(camera)
    _, columns, triangles = parse(report_to_ply(report))
    for plane in report.planes:
        vertices, _ = of_patch(columns, triangles, plane.id)
        points = vertices[:, :3]
        assert np.abs(points @ plane.normal_cam1 + plane.distance).max() < 1e-6 * plane.distance
        uv = pixels_from_rays(camera, points[:, :2] / points[:, 2:])
        low, high = plane.polygon_px.min(axis=0), plane.polygon_px.max(axis=0)
        np.testing.assert_allclose(uv.min(axis=0), low, atol=1e-3)
        np.testing.assert_allclose(uv.max(axis=0), high, atol=1e-3)
        assert np.abs(vertices[:, 3:6] - plane.normal_cam1).max() < 1e-6


def test_patches_carry_colour_slope_sigma_and_id() -> None:
    report = make_report()
    _, columns, triangles = parse(report_to_ply(report))
    for plane in report.planes:
        vertices, _ = of_patch(columns, triangles, plane.id)
        assert (vertices[:, 6:9] == slope_colours(plane.slope_deg)[0]).all()
        assert np.allclose(vertices[:, 9:12], [plane.slope_deg, plane.slope_deg, plane.slope_sigma_deg])


def test_faces_show_their_front_to_camera_1() -> None:
    _, columns, triangles = parse(report_to_ply(make_report(DISTORTED)))
    patches = triangles[columns[triangles[:, 0], 12] > 0]
    a, b, c = columns[patches][:, :, :3].transpose(1, 0, 2)
    front = np.cross(b - a, c - a)
    assert ((front * -a).sum(axis=1) > 0).all()


def test_cameras_stand_where_they_were() -> None:
    """The apex of a camera is at its centre; its base looks along its axis."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]
    )
    report = make_report(motion=Motion(turn, BASELINE, 97.0, 0.01, 0.05))
    _, columns, triangles = parse(report_to_ply(report))
    vertices, faces = of_patch(columns, triangles, 0)
    assert len(vertices) == 10
    assert len(faces) == 12
    assert (vertices[:, 9:12] == 0).all()
    for apex, base, centre, axis in ((0, range(1, 5), np.zeros(3), [0, 0, 1]), (5, range(6, 10), BASELINE, turn[2])):
        np.testing.assert_allclose(vertices[apex, :3], centre, atol=1e-7)
        ahead = vertices[list(base), :3].mean(axis=0) - centre
        np.testing.assert_allclose(
            ahead / np.linalg.norm(ahead), axis, atol=1e-2
        )  # the principal point is half a pixel off


CORNERS = 200 + 150 * np.column_stack([f(np.linspace(0, 2 * np.pi, 7)[:-1]) for f in (np.cos, np.sin)])


@pytest.mark.parametrize("polygon", [rectangle(9, 9, 30, 20), rectangle(9, 9, 30, 20)[:3], CORNERS, CORNERS[::-1]])
def test_triangles_tile_a_convex_polygon(polygon: np.ndarray) -> None:
    mesh = planes_mesh([make_plane(1, polygon, 5.0)], make_camera())
    assert len(mesh.triangles) == 16 * (len(polygon) - 2)
    points = np.column_stack([mesh.vertices[axis] for axis in "xyz"]).astype(float)
    areas = 0.5 * np.abs(doubled_area(pixels_from_rays(make_camera(), points[:, :2] / points[:, 2:])[mesh.triangles]))
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(polygon_area(polygon), rel=1e-4)


def test_ground_beyond_the_horizon_is_left_out() -> None:
    """A wall seen almost along its surface reaches infinity within its window; the part in front is kept."""
    camera = make_camera()
    along = make_plane(1, rectangle(0, 0, 639, 479), 90.0, azimuth_deg=0.0, distance=1.0)
    mesh = planes_mesh([along], camera)
    assert len(mesh.triangles)
    assert np.isfinite(mesh.vertices["z"]).all()
    assert (mesh.vertices["z"] > 0).all()
    behind = replace(along, normal_cam1=-normal_of(10, 0))
    assert not len(planes_mesh([behind], camera).triangles)
    _, columns, _ = parse(report_to_ply(make_report(planes=(behind,))))
    assert set(columns[:, 12]) == {0.0}


def test_pixels_the_lens_does_not_image_are_left_out() -> None:
    folded = Camera(640, 480, 300, 300, 320, 240, "brown", (-0.4,))
    mesh = planes_mesh([make_plane(1, rectangle(0, 0, 639, 479), 5.0)], folded)
    assert len(mesh.triangles)
    assert np.isfinite(mesh.vertices["x"]).all()


def region_ply(report: Report, image: Image | None) -> tuple[list[str], np.ndarray, np.ndarray]:
    return parse(report_to_ply(report, image, region_surfaces(report)))


@pytest.mark.parametrize("camera", [make_camera(), DISTORTED], ids=["pinhole", "distorted"])
def test_regions_lie_on_their_planes_with_normals_and_scalars(camera: Camera) -> None:
    report = make_region_report(camera)
    _, columns, triangles = region_ply(report, make_image())
    for plane in report.planes:
        vertices, faces = of_patch(columns, triangles, plane.id)
        assert len(faces) > 100
        assert np.abs(vertices[:, :3] @ plane.normal_cam1 + plane.distance).max() < 1e-6 * plane.distance
        assert np.abs(vertices[:, 3:6] - plane.normal_cam1).max() < 1e-6
        assert np.allclose(vertices[:, 9:12], [plane.slope_deg, plane.slope_deg, plane.slope_sigma_deg])
        a, b, c = columns[faces][:, :, :3].transpose(1, 0, 2)
        assert (np.cross(b - a, c - a) @ plane.normal_cam1 > 0).all()
    assert set(columns[:, 12]) == {0, 1, 2, 3, 4, 5}  # the cameras are there too


def test_regions_have_the_colours_of_the_image_red_first() -> None:
    colour = np.zeros((480, 640, 3), np.uint8)
    colour[..., 0], colour[..., 1], colour[..., 2] = 30, (np.arange(640) // 3)[None], (np.arange(480) // 2)[:, None]
    report = make_region_report()
    _, columns, _ = region_ply(report, Image(np.zeros((480, 640), np.uint8), colour))
    vertices = columns[columns[:, 12] > 0]
    uv = pixels_from_rays(report.cameras[0], vertices[:, :2] / vertices[:, 2:3])
    expected = np.column_stack([uv[:, 1] / 2, uv[:, 0] / 3, np.full(len(uv), 30)])
    assert np.abs(vertices[:, 6:9] - expected).max() < 3
    _, columns, _ = region_ply(report, Image(np.full((480, 640), 77, np.uint8)))
    assert (columns[columns[:, 12] > 0][:, 6:9] == 77).all()


def test_regions_without_an_image_have_the_colour_of_their_slope() -> None:
    report = make_region_report()
    _, columns, triangles = region_ply(report, None)
    for plane in report.planes:
        vertices, _ = of_patch(columns, triangles, plane.id)
        assert (vertices[:, 6:9] == slope_colours(plane.slope_deg)[0]).all()


def test_image_leaves_windows_as_they_are() -> None:
    report = make_report()
    assert report_to_ply(report, make_image(), region_surfaces(report)) == report_to_ply(report)


def test_unknown_sigma_is_written_as_zero_not_nan() -> None:
    plane = make_plane(1, rectangle(100, 100, 50, 50), 5.0, slope_sigma_deg=float("nan"))
    _, columns, _ = parse(report_to_ply(make_report(planes=(plane,))))
    assert (columns[:, 11] == 0).all()


def test_header_names_unit_and_frame() -> None:
    lines, _, _ = parse(report_to_ply(make_report()))
    assert "comment unit baseline" in lines
    assert any("frame z up" in line for line in lines)
    lines, _, _ = parse(report_to_ply(in_frame(make_report(), "camera")))
    assert "comment frame camera 1: x right, y down, z forward" in lines
    assert "comment unit m" in parse(report_to_ply(make_report(scale=Scale("m", "altitude"))))[0]


def in_frame(report: Report, frame: str, **options: object) -> Report:
    return replace(report, options={**report.options, "ply_frame": frame, **options})


@pytest.mark.parametrize("up", [(0.0, 0.0, -1.0), (0.1, -0.6, -0.7), (0.0, -1.0, 0.0)], ids=str)
def test_up_is_z_north_is_y_and_nothing_is_mirrored(up: tuple[float, float, float]) -> None:
    trimesh = pytest.importorskip("trimesh")
    report = replace(make_report(), up=Up(up, "given"))

    def read(report: Report) -> np.ndarray:
        mesh = trimesh.load(io.BytesIO(report_to_ply(report)), file_type="ply", process=False)
        return np.asarray(mesh.vertices)

    north = np.array([0.8, 0.6, 0.1])
    standing, as_seen = read(in_frame(report, "up", north=tuple(north))), read(in_frame(report, "camera"))
    turn = np.linalg.lstsq(as_seen, standing, rcond=None)[0].T  # standing = turn @ as_seen
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-5)
    assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(turn @ up / np.linalg.norm(up), [0, 0, 1], atol=1e-5)
    east, ahead, _ = turn @ north
    assert abs(east) < 1e-5
    assert ahead > 0


def test_trimesh_reads_what_was_written() -> None:
    trimesh = pytest.importorskip("trimesh")
    data = report_to_ply(in_frame(make_report(), "camera"))
    _, columns, triangles = parse(data)
    mesh = trimesh.load(io.BytesIO(data), file_type="ply", process=False)
    np.testing.assert_allclose(mesh.vertices, columns[:, :3])
    assert np.array_equal(mesh.faces, triangles)
    assert np.array_equal(mesh.visual.vertex_colors[:, :3], columns[:, 6:9])
    cameras = columns[triangles[:, 0], 12] == 0
    both = mesh.submesh([np.nonzero(cameras)[0]], append=True)
    assert both.is_watertight
    assert both.volume > 0  # faces outwards
