"""patches.glb: its format by an independent parser, its content by trimesh."""

from __future__ import annotations

import io
import json
import struct
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from report_factory import (
    make_ambiguity,
    make_camera,
    make_image,
    make_region_labels,
    make_region_report,
    with_level_plane,
)

from slopecli.geometry import pixels_from_rays
from slopecli.products import LARGEST_TEXTURE_PX, model_from_camera1, region_surfaces, report_to_glb
from slopecli.types import Camera, Image, Report, Scale, Up

DISTORTED = Camera(640, 480, 420.0, 421.0, 318.0, 242.0, "brown", (-0.28, 0.07, 2e-4, -1e-4))
TILTED_UP = (0.1, -0.7, -0.7071)
IMAGE = make_image(colour=True)


def glb_of(report: Report, image: Image = IMAGE) -> bytes:
    return report_to_glb(report, image, region_surfaces(report))


def parse(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary chunk; strict about lengths and padding."""
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    tree = json.loads(data[20 : 20 + size])
    if 20 + size == len(data):
        return tree, b""
    rest, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0"
    assert rest % 4 == 0
    assert 28 + size + rest == len(data)
    return tree, data[28 + size :]


def scene_of(data: bytes) -> Any:
    trimesh = pytest.importorskip("trimesh")
    return trimesh.load(io.BytesIO(data), file_type="glb", process=False)


def test_file_keeps_the_format() -> None:
    tree, binary = parse(glb_of(make_region_report()))
    assert tree["buffers"] == [{"byteLength": len(binary)}]
    ends = [view["byteOffset"] + view["byteLength"] for view in tree["bufferViews"]]
    starts = [view["byteOffset"] for view in tree["bufferViews"]]
    assert all(start % 4 == 0 for start in starts)
    assert all(0 <= start - end < 4 for start, end in zip(starts[1:], ends, strict=False))
    assert ends[-1] <= len(binary) < ends[-1] + 4
    widths = {("SCALAR", 5123): 2, ("SCALAR", 5125): 4, ("VEC2", 5126): 8, ("VEC3", 5126): 12}
    for accessor in tree["accessors"]:
        view = tree["bufferViews"][accessor["bufferView"]]
        assert view["byteLength"] == accessor["count"] * widths[accessor["type"], accessor["componentType"]]


def test_one_node_and_mesh_per_plane_with_what_is_known_of_it() -> None:
    report = make_region_report()
    tree, _ = parse(glb_of(report))
    names = [f"plane {plane.id} ({plane.slope_deg:.1f} deg)" for plane in report.planes]
    assert names[0] == "plane 1 (12.0 deg)"
    assert [mesh["name"] for mesh in tree["meshes"]] == [node["name"] for node in tree["nodes"]] == names
    for node, plane in zip(tree["nodes"], report.planes, strict=True):
        facts = node["extras"]
        assert (facts["id"], facts["slope_deg"], facts["verdict"]) == (plane.id, plane.slope_deg, plane.verdict)
    unknown = replace(report.planes[0], slope_sigma_deg=float("nan"))
    tree, _ = parse(glb_of(replace(report, planes=(unknown,))))
    assert tree["nodes"][0]["extras"]["slope_sigma_deg"] is None


@pytest.mark.parametrize(("unit", "source"), [("m", "altitude"), ("baseline", "none")])
def test_unit_and_axes_are_said(unit: Any, source: Any) -> None:
    report = make_region_report(scale=Scale(unit, source), up=Up(TILTED_UP, "given"))
    extras = parse(glb_of(report))[0]["asset"]["extras"]
    assert extras["unit"] == unit
    np.testing.assert_allclose(extras["model_from_camera1"], model_from_camera1(np.array(TILTED_UP)), atol=1e-8)


@pytest.mark.parametrize("camera", [make_camera(), DISTORTED], ids=["pinhole", "distorted"])
@pytest.mark.parametrize("up", [(0.0, 0.0, -1.0), TILTED_UP])
def test_model_is_the_planes_turned_upright_under_their_pixels(camera: Camera, up: tuple[float, float, float]) -> None:
    report = make_region_report(camera, up=Up(up, "given"))
    scene = scene_of(glb_of(report))
    turn = model_from_camera1(np.array(up))
    assert len(scene.geometry) == len(report.planes)
    for plane in report.planes:
        mesh = scene.geometry[f"plane {plane.id} ({plane.slope_deg:.1f} deg)"]
        points = mesh.vertices @ turn
        assert np.abs(points @ plane.normal_cam1 + plane.distance).max() < 1e-6
        uv = pixels_from_rays(camera, points[:, :2] / points[:, 2:])
        shown = np.column_stack([mesh.visual.uv[:, 0], 1.0 - mesh.visual.uv[:, 1]])  # trimesh counts v from below
        np.testing.assert_allclose((uv + 0.5) / [640, 480], shown, atol=1e-5)
        assert (mesh.face_normals @ turn @ plane.normal_cam1 > 0.99).all()


@pytest.mark.parametrize(
    "up", [(0.0, 0.0, -1.0), (0.0, -1.0, 0.0), (0.0, -0.6, -0.8), (0.6, 0.0, -0.8), (-1.0, 0.0, 0.0)]
)
def test_up_is_y_and_ahead_is_minus_z(up: tuple[float, float, float]) -> None:
    turn = model_from_camera1(np.array(up))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(turn @ up, [0, 1, 0], atol=1e-12)
    view, image_up = turn @ [0, 0, 1], turn @ [0, -1, 0]
    assert (view if np.hypot(view[0], view[2]) > 0.5 else image_up)[2] < 0
    assert abs((view if np.hypot(view[0], view[2]) > 0.5 else image_up)[0]) < 1e-9


def test_texture_is_the_image_in_its_colours_and_not_shaded() -> None:
    data = glb_of(make_region_report())
    tree, binary = parse(data)
    view = tree["bufferViews"][tree["images"][0]["bufferView"]]
    jpeg = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    read = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert IMAGE.colour is not None
    assert np.abs(read.astype(int) - IMAGE.colour).mean() < 12  # noise at one pixel is what JPEG takes away
    assert np.abs(cv2.blur(read, (8, 8)).astype(int) - cv2.blur(IMAGE.colour, (8, 8))).mean() < 2
    (material,) = tree["materials"]
    assert "KHR_materials_unlit" in material["extensions"]
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 0
    assert scene_of(data).geometry["plane 2 (22.0 deg)"].visual.material.baseColorTexture.size == (640, 480)


def test_grey_and_large_images_are_textures_too() -> None:
    camera = make_camera(2100, 300)
    report = make_region_report(camera, make_region_labels(2100, 300))
    image = Image(np.full((300, 2100), 90, np.uint8))
    scene = scene_of(glb_of(report, image))
    texture = next(iter(scene.geometry.values())).visual.material.baseColorTexture
    assert max(texture.size) == LARGEST_TEXTURE_PX
    assert np.abs(np.asarray(texture.convert("RGB")).astype(int) - 90).max() <= 2


def test_a_second_answer_is_in_names_and_extras() -> None:
    report = make_region_report()
    tree, _ = parse(glb_of(replace(report, ambiguity=make_ambiguity(report))))
    assert tree["asset"]["extras"]["ambiguity"] == "unresolved"
    (node,) = (node for node in tree["nodes"] if node["extras"]["id"] == 2)
    assert node["name"] == tree["meshes"][node["mesh"]]["name"] == "plane 2 (22.0 deg or 42.0 deg)"
    assert node["extras"]["second_answer"] == {"slope_deg": 42.0, "slope_sigma_deg": 0.7, "aspect_deg": 10.0}
    tree, _ = parse(glb_of(report))
    assert tree["asset"]["extras"]["ambiguity"] == "none"
    assert not any("second_answer" in node["extras"] for node in tree["nodes"])


def test_the_plane_taken_as_level_is_named_so() -> None:
    tree, _ = parse(glb_of(with_level_plane(make_region_report())))
    (node,) = (node for node in tree["nodes"] if node["extras"]["id"] == 1)
    assert node["name"] == "plane 1 (taken as level)"
    assert (node["extras"]["slope_deg"], node["extras"]["slope_sigma_deg"], node["extras"]["verdict"]) == (
        0,
        None,
        None,
    )


def test_same_report_gives_same_bytes() -> None:
    assert glb_of(make_region_report()) == glb_of(make_region_report())


def test_scene_without_surfaces_is_a_file_still() -> None:
    tree, binary = parse(report_to_glb(make_region_report(), IMAGE, []))
    assert binary == b""
    assert "nodes" not in tree["scenes"][0]
