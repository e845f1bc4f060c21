"""Camera files that are easily misread: each is understood, or refused in one line."""

from __future__ import annotations

import json
import struct
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from camera_factory import MATRIX, NATIVE, refusal, write

from slopecli.errors import InputError
from slopecli.io.cameras import camera_from_fov, camera_from_intrinsics, decode_camera, load_camera
from slopecli.types import Camera

SIZE = (1024, 768)
PLAIN = {"K": MATRIX, "D": [-0.28, 0.07, 0.0, 0.0, 0.0]}
CX, CY = 511.5, 383.5


# ---- image sizes under their many names ----

SIZES = [
    {"image_Width": 1024, "image_Height": 768},
    {"IMAGE_WIDTH": "1024", "IMAGE_HEIGHT": "768"},
    {"imgWidth": 1024, "imgHeight": 768},
    {"Width": 1024.0, "Height": 768.0},
    {"frame_width": 1024, "frame_height": 768},
    {"cols": 1024, "rows": 768},
    {"res_x": 1024, "res_y": 768},
    {"DIM": [1024, 768]},
    {"nx": 1024, "ny": 768},
    {"width": "1024px", "height": "768 px"},
    {"resolution_width": 1024, "resolution_height": 768},
    {"calibImageSize": [1024, 768]},
    {"size_of_image": [1024, 768]},
    {"dims": [1024, 768]},
    {"size": [1024, 768]},
    {"Image_Size": [1024, 768]},
    {"frame_size": [1024, 768]},
    {"resolution": {"width": 1024, "height": 768}},
    {"Resolution": [1024, 768]},
    {"resolution": "1024x768"},
    {"image_resolution": "1024 x 768"},
    {"img_size": {"w": 1024, "h": 768}},
    {"size": {"x": 1024, "y": 768}},
    {"image": {"width": 1024, "height": 768}},
    {"calibration": {"frame": {"size": [1024, 768]}}},
    {"image_size": {"rows": 1, "cols": 2, "dt": "i", "data": [1024, 768]}},
    {"img_shape": [768, 1024]},
    {"shape": [768, 1024, 3]},
    {"imageShape": [1024, 768]},
    {"ImageSize": [768, 1024]},
    {"width": 1024, "height": 768, "image_size": [1024, 768]},
    {"width": 1024, "height": 768, "roi": {"width": 10, "height": 20}, "board_size": [9, 6]},
]


@pytest.mark.parametrize("keys", SIZES, ids=lambda keys: json.dumps(keys)[:50])
def test_sizes_are_read_under_the_usual_keys(tmp_path: Path, keys: dict) -> None:
    camera = load_camera(write(tmp_path, {**PLAIN, **keys}), size=(512, 384))
    assert (camera.width, camera.height) == SIZE
    assert camera.size_given


@pytest.mark.parametrize("key", ["ImageSize", "image_size", "img_shape"])
def test_rows_before_columns_are_told_by_the_centre_and_said(tmp_path: Path, key: str) -> None:
    camera = load_camera(write(tmp_path, {**PLAIN, key: [768, 1024]}))
    assert (camera.width, camera.height) == SIZE
    assert f"{key} [768, 1024] is read as rows x columns" in camera.note


def test_a_portrait_camera_is_not_turned(tmp_path: Path) -> None:
    matrix = [[800, 0, 383.5], [0, 800, 511.5], [0, 0, 1]]
    camera = load_camera(write(tmp_path, {"K": matrix, "image_size": [768, 1024]}), size=(1024, 768))
    assert (camera.width, camera.height, camera.note) == (768, 1024, "")


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"image_width": 1024, "image_height": 768, "size": [640, 480]}, "keep one of them"),
        ({"width": 1024, "image_width": 640, "height": 768}, "differ"),
        ({"image_size": [1024]}, "needed width and height"),
        ({"image_width": 1024}, "height is None"),
        ({"image_size": [1024, -768]}, "whole number of pixels"),
        ({"image_size": "big"}, "needed a number"),
    ],
)
def test_sizes_that_contradict_or_are_none(tmp_path: Path, keys: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, {**PLAIN, **keys}), size=SIZE)


def test_a_camera_without_a_size_says_so(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, PLAIN), size=SIZE)
    assert not camera.size_given
    assert "gives no image size: taken to be for 1024x768 px" in camera.note


def test_a_camera_without_a_size_whose_centre_is_outside_the_image_is_refused(tmp_path: Path) -> None:
    assert "outside the image of 400x300 px" in refusal(write(tmp_path, PLAIN), size=(400, 300))


# ---- marks of the lens ----

FISHEYE = {"K": MATRIX, "D": [[0.05], [-0.02], [0.01], [-0.002]], "image_size": [1024, 768]}


@pytest.mark.parametrize(
    "mark",
    [
        {"is_fisheye": True},
        {"isFisheye": "true"},
        {"fisheye": 1},
        {"use_fisheye": "yes"},
        {"fisheye_model": 1},
        {"projection_type": "fisheye"},
        {"camera_type": "FISHEYE"},
        {"lens": "fisheye"},
        {"lens_type": "Equidistant"},
        {"model": "kannala_brandt"},
        {"model": "cv2.fisheye"},
        {"camera_model": "KANNALA_BRANDT4"},
        {"distortion_model": "equidistant"},
        {"distModel": "equi"},
        {"type": "opencv_fisheye"},
        {"projection": "equidistant"},
        {"info": {"lens": {"model": "fisheye"}}},
        {"D": {"rows": 1, "cols": 4, "data": [0.05, -0.02, 0.01, -0.002], "model": "fisheye"}},
        {"camera_model": "pinhole", "distortion_type": "fisheye"},
    ],
    ids=json.dumps,
)
def test_fisheye_marks_are_read(tmp_path: Path, mark: dict) -> None:
    camera = load_camera(write(tmp_path, {**FISHEYE, **mark}))
    assert (camera.model, camera.distortion, camera.note) == ("fisheye", (0.05, -0.02, 0.01, -0.002), "")


@pytest.mark.parametrize(
    "mark",
    [
        {"model": "omnidirectional"},
        {"lens": "double_sphere"},
        {"projection_type": "equirectangular"},
        {"camera_type": "spherical"},
        {"distortion_model": "inverse_brown_conrady"},
        {"distortion_model": "modified_brown_conrady"},
        {"lens_model": "f-theta"},
        {"type": "omni"},
        {"is_fisheye": "perhaps"},
        {"is_fisheye": [1]},
        {"optic": "fisheye, 180 degrees"},
        {"wide_fisheye_lens_used": True},
        {"model": "radtan", "is_fisheye": True},
        {"model": "fisheye", "is_fisheye": False},
        {"lens": {"kind": "fish-eye"}},
        {"Fisheye_Lens_Used_Here": "perhaps"},
        {"camera_lens": "anything"},
    ],
    ids=json.dumps,
)
def test_marks_that_are_unknown_or_contradict_are_refused(tmp_path: Path, mark: dict) -> None:
    *_, (key, value) = mark.items()
    name = next(iter(value)) if isinstance(value, dict) else key
    assert name in refusal(write(tmp_path, {**FISHEYE, **mark})).removeprefix(str(tmp_path))


def test_marks_of_no_fisheye_and_prose_change_nothing(tmp_path: Path) -> None:
    for words in ({"is_fisheye": False}, {"model": "brown"}, {"type": "camera"}, {"comment": "not a fisheye"}):
        assert load_camera(write(tmp_path, {**FISHEYE, **words})).model == "brown"


def test_how_four_coefficients_without_a_mark_are_read_is_said(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, FISHEYE))
    assert camera.model == "brown"
    assert "read as k1 k2 p1 p2" in camera.note
    assert "fisheye" in camera.note
    assert load_camera(write(tmp_path, {**FISHEYE, "model": "plumb_bob"})).note == ""
    assert load_camera(write(tmp_path, {**FISHEYE, "D": [0, 0, 0, 0]})).note == ""


# ---- units ----


@pytest.mark.parametrize("focal", [0.024, 0.866, 3.6, 8.8, 12.29, 16, 24, 35, 50, 85, 1e7])
def test_a_focal_length_that_is_not_in_pixels_is_refused_with_its_unit(focal: float) -> None:
    with pytest.raises(InputError, match=r"field of view of .* (millimetres|image width|micrometres)"):
        camera_from_intrinsics((focal, focal, 399.5, 399.5), 800, 800)


@pytest.mark.parametrize("fov", [0.5, 0.7854, 1.047, 1.5708, 2.09, 3.14])
def test_a_field_of_view_in_radians_is_refused(fov: float) -> None:
    with pytest.raises(InputError, match="radians"):
        camera_from_fov(fov, 800, 800)


@pytest.mark.parametrize("key", ["c_x", "c_y"])
def test_opensfm_centres_from_a_corner_are_refused(tmp_path: Path, key: str) -> None:
    tree = {
        "a": {"projection_type": "brown", "width": 800, "height": 800, "focal_x": 0.866, "focal_y": 0.866, key: 0.5}
    }
    assert "from the middle" in refusal(write(tmp_path, tree))


@pytest.mark.parametrize("focal", [35, 692])
def test_opensfm_focal_lengths_in_another_unit_are_refused(tmp_path: Path, focal: float) -> None:
    tree = {"a": {"projection_type": "brown", "width": 800, "height": 800, "focal": focal}}
    assert "units of the longer side" in refusal(write(tmp_path, tree))


@pytest.mark.parametrize("matrix", [[[0, 0, 0]] * 3, np.eye(3).tolist(), [[0, 0, 0], [0, 0, 0], [0, 0, 1]]])
def test_matrices_of_cameras_that_are_not_calibrated(tmp_path: Path, matrix: list) -> None:
    assert "not calibrated" in refusal(write(tmp_path, {"K": matrix, "D": [0] * 5, "image_size": [1024, 768]}))


@pytest.mark.parametrize("coefficients", [[1e308] * 5, [1e300, 0, 0, 0, 0], [0, 0, 0, 0, 1e9], [-1e5, 0, 0, 0, 0]])
def test_distortion_of_no_lens_is_refused_in_silence(tmp_path: Path, coefficients: list) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "distortion" in refusal(write(tmp_path, {**NATIVE, "distortion": coefficients}))


@pytest.mark.parametrize("tail", [[0.11], [1e-320], [-1e-200]])
def test_odd_but_real_distortion_is_read_in_silence(tmp_path: Path, tail: list) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        camera = load_camera(write(tmp_path, {**NATIVE, "distortion": [-0.45, 0.25, 0, 0, 0, 0, 0, *tail]}))
    assert camera.distortion == (-0.45, 0.25, 0, 0, 0, 0, 0, *tail)


# ---- several cameras in a file ----


def rig(**root: object) -> dict:
    frames = [
        {"file_path": f"{folder}/000{k}.png", "w": 800, "h": 800, "fl_x": focal, "cx": 400, "cy": 400}
        for folder, focal in (("./cam0", 700), ("cam1", 1100))
        for k in (1, 2)
    ]
    return {"camera_model": "OPENCV", **root, "frames": frames}


def test_frames_are_named_by_their_paths(tmp_path: Path) -> None:
    path = write(tmp_path, rig())
    assert load_camera(f"{path}#cam0/0001.png").fx == 700
    assert load_camera(f"{path}#cam1/0002.png").fx == 1100
    for ambiguous in ("0001.png", "0001"):
        message = refusal(f"{path}#{ambiguous}")
        assert f"2 cameras for {ambiguous!r}" in message
        assert "cam0/0001.png, cam1/0001.png" in message
    assert "no camera 'cam2/0001.png'" in refusal(f"{path}#cam2/0001.png")
    assert "no camera" in refusal(f"{path}#")


@pytest.mark.parametrize(("image", "focal"), [("flight/cam0/0001.png", 700), ("/data/x/cam1/0002.png", 1100)])
def test_the_path_of_the_image_picks_its_camera_and_it_is_said(image: str, focal: float) -> None:
    camera = decode_camera(json.dumps(rig()).encode(), "rig.json", image=image)
    assert camera.fx == focal
    assert f"is that of {image}" in camera.note


def test_an_image_that_fits_several_frames_or_none_is_refused() -> None:
    data = json.dumps(rig()).encode()
    with pytest.raises(InputError, match=r"2 cameras for this image; .*cam0/0001\.png, cam1/0001\.png"):
        decode_camera(data, "rig.json", image="flight/0001.png")
    with pytest.raises(InputError, match="holds 4 cameras"):
        decode_camera(data, "rig.json", image="flight/0009.png")


@pytest.mark.parametrize(
    ("image", "camera"),
    [("mav0/cam0/data/17.png", "cam0"), ("x/cam1_17.png", "cam1"), ("left01.jpg", None), ("cam01.png", None)],
)
def test_cameras_of_a_rig_are_told_by_folder_or_name(image: str, camera: str | None) -> None:
    one = {"camera_model": "pinhole", "intrinsics": [400, 400, 319.5, 239.5], "resolution": [640, 480]}
    data = json.dumps({"cam0": one, "cam1": {**one, "intrinsics": [500, 500, 319.5, 239.5]}}).encode()
    if camera is None:
        with pytest.raises(InputError, match="holds 2 cameras"):
            decode_camera(data, "chain.json", image=image)
    else:
        assert decode_camera(data, "chain.json", image=image).fx == {"cam0": 400, "cam1": 500}[camera]


def test_an_id_is_not_taken_for_the_name_of_an_image() -> None:
    data = b"1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 640 480 600 600 320 240\n"
    with pytest.raises(InputError, match="holds 2 cameras"):
        decode_camera(data, "cameras.txt", image="2.png")


def test_root_and_frame_are_merged_and_the_frame_wins() -> None:
    own = {"file_path": "image1.png", "w": 800, "h": 800, "cx": 421, "cy": 381, "k1": -0.06}
    tree = {
        "fl_x": 700,
        "fl_y": 710,
        "cx": 400,
        "k2": 0.01,
        "frames": [own, {**own, "file_path": "image2.png", "cx": 1}],
    }
    camera = decode_camera(json.dumps(tree).encode(), "t.json", "image1.png")
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (700, 710, 420.5, 380.5)
    assert camera.distortion[:2] == (-0.06, 0.01)
    assert (
        "fl_x, fl_y, k2 of the whole file and w, h, cx, cy, k1 of the frame (cx instead of the file's)" in camera.note
    )


def test_frames_with_one_and_the_same_camera_need_no_choice() -> None:
    own = {"file_path": "a.png", "w": 800, "h": 800, "fl_x": 700, "cx": 400, "cy": 400}
    camera = decode_camera(json.dumps({"frames": [own, {**own, "file_path": "b.png"}]}).encode(), "t.json")
    assert camera.fx == 700
    assert "its 2 cameras are the same" in camera.note


# ---- twice the same name ----

TWICE = {
    "json": '{"width": 1024, "height": 768, "fx": 800, "fy": 800, "cx": 500, "cy": 380, "fx": 400}',
    "json-deep": '{"cameras": {"a": {"projection_type": "brown", "focal": 0.8, "focal": 0.9}}}',
    "json-frames": '{"fl_x": 700, "frames": [{"file_path": "a", "cx": 1}, {"file_path": "./a", "cx": 2}]}',
    "yaml": "K: [[800, 0, 511], [0, 800, 383], [0, 0, 1]]\nD: [-0.2, 0, 0, 0]\nD: []\n",
    "yaml-nested": "cam0:\n  camera_model: pinhole\n  intrinsics: [1, 2, 3, 4]\n  intrinsics: [4, 3, 2, 1]\n",
    "yaml-opencv": "%YAML:1.0\n---\nK: !!opencv-matrix {rows: 3, rows: 3, cols: 3, dt: d, data: [1]}\n",
    "colmap": "1 PINHOLE 1024 768 800 800 512 384\n1 PINHOLE 1024 768 400 400 512 384\n",
    "xml": "<opencv_storage><K>1</K><K>2</K></opencv_storage>",
    "metashape": "<calibration><f>1000</f><f>2000</f></calibration>",
}


@pytest.mark.parametrize("text", TWICE.values(), ids=TWICE)
def test_a_name_or_id_that_stands_twice_is_refused(tmp_path: Path, text: str) -> None:
    assert "twice; keep one of them" in refusal(write(tmp_path, text), size=SIZE)


def test_colmap_binary_ids_and_archives_with_a_name_twice_are_refused(tmp_path: Path) -> None:
    record = struct.pack("<IiQQ4d", 1, 1, 640, 480, 500, 500, 320, 240)
    assert "'camera 1' twice" in refusal(write(tmp_path, struct.pack("<Q", 2) + 2 * record, "cameras.bin"))
    np.save(tmp_path / "K.npy", np.array(MATRIX))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with zipfile.ZipFile(tmp_path / "twice.npz", "w") as archive:
            for _ in range(2):
                archive.writestr("K.npy", (tmp_path / "K.npy").read_bytes())
    assert "'K' twice" in refusal(tmp_path / "twice.npz", size=SIZE)


@pytest.mark.parametrize(("models", "readable"), [((1, 17), 1), ((17, 1), 2), ((99, 1, 99), 2), ((1, 77, 88), 1)])
def test_colmap_models_that_are_not_known_leave_the_others_readable(
    tmp_path: Path, models: tuple[int, ...], readable: int
) -> None:
    counts = {1: 4, 17: 2, 99: 7, 77: 2, 88: 5}
    numbers = (500.0, 500.0, 400.0, 300.0, 0.1, 0.2, 0.3)
    records = [
        struct.pack(f"<IiQQ{counts[m]}d", i, m, 800, 600, *numbers[: counts[m]]) for i, m in enumerate(models, 1)
    ]
    path = write(tmp_path, struct.pack("<Q", len(records)) + b"".join(records), "cameras.bin")
    assert load_camera(f"{path}#{readable}") == Camera(800, 600, 500, 500, 399.5, 299.5, source="COLMAP")
    other = next(i for i, model in enumerate(models, 1) if model != 1)
    message = refusal(f"{path}#{other}")
    assert ("EQUIRECTANGULAR" if 17 in models else f"id {models[other - 1]}") in message


# ---- documents, encodings, hostile files ----


def test_yaml_documents_are_merged_and_said_or_refused(tmp_path: Path) -> None:
    one, two = f"K: {MATRIX}\n", "D: [-0.06, 0.012, 0, 0, 0]\n"
    camera = load_camera(write(tmp_path, f"{one}---\n{two}"), size=SIZE)
    assert camera.distortion[:2] == (-0.06, 0.012)
    assert "2 documents are read together" in camera.note
    for text in (f"{one}---\n{two}---\nD: []\n", f"{{{one.strip()}}}\n{{{two.strip()}}}\n", f"{one}---\njust text\n"):
        assert "documents" in refusal(write(tmp_path, text), size=SIZE)
    assert "more than one JSON value" in refusal(write(tmp_path, json.dumps(NATIVE) * 2))


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8-sig", "utf-16", "utf-8"])
def test_text_of_other_encodings_is_read(tmp_path: Path, encoding: str) -> None:
    text = f"# étalonnée le 12 février\ncamera_matrix: {MATRIX}\nimage_size: [1024, 768]\n"
    assert load_camera(write(tmp_path, text.encode(encoding))).fx == 800


@pytest.mark.parametrize(("fx", "read"), [("692", 692.0), ("6.92e2", 692.0), ("0692", 692.0), ("0764", 764.0)])
def test_numbers_of_yaml_are_decimal(tmp_path: Path, fx: str, read: float) -> None:
    """Of old YAML a zero in front makes them octal, and a colon makes them minutes or hours."""
    camera = "width: 1024\nheight: 768\nfy: 700\ncx: 511.5\ncy: 383.5\n"
    assert load_camera(write(tmp_path, f"{camera}fx: {fx}\n")).fx == read
    for clock in ("11:32", "11:32.5", "!!int 11:32"):
        assert "11:32" in refusal(write(tmp_path, f"{camera}fx: {clock}\n"))


BOMB = "".join(
    ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"]
    + [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 10)]
)
HOSTILE = {
    "bomb": f"{BOMB}camera_matrix: *a9\n",
    "bomb-merge": f"{BOMB}width: 1024\nheight: 768\nfx: 1\nfy: 1\ncx: 1\ncy: 1\ndistortion: *a9\n",
    "recursive": "K: &a [*a, *a]\n",
    "recursive-map": "K: &a {b: *a}\n",
    "bool": "fx: !!bool x\n",
    "int": 'fx: !!int ""\n',
    "float": "fx: !!float x\n",
    "timestamp": "fx: !!timestamp x\n",
    "set": "fx: !!set [1]\n",
    "omap": "fx: !!omap 3\n",
    "huge-int": f'{{"width": 1024, "height": 768, "fx": {"9" * 5000}, "fy": 1, "cx": 1, "cy": 1}}',
    "huge-int-yaml": f"width: 1024\nheight: 768\nfx: {'9' * 5000}\nfy: 1\ncx: 1\ncy: 1\n",
    "int-400": f'{{"width": 1024, "height": 768, "fx": {"9" * 400}, "fy": 1, "cx": 1, "cy": 1}}',
    "deep-json": '{"K":' + "[" * 900 + "]" * 900 + "}",
    "deep-yaml": "K: " + "[" * 900 + "]" * 900,
    "deep-dashes": "- " * 30000,
    "deep-xml": "<opencv_storage>" + "<a>" * 5000 + "</a>" * 5000 + "</opencv_storage>",
    "entities": '<!DOCTYPE x [<!ENTITY a "aaaa">]><opencv_storage><K>&a;</K></opencv_storage>',
    "bom": "\ufeff",
    "numbers-for-frames": '{"frames": [1, "x", null, [], {"fl_x": {}, "file_path": 3}]}',
    "number-for-a-name": "1: 2\nfl_x: 800\nframes: [{file_path: a, 3: 4, w: 5}]\n",
    "list-of-maps": '{"intrinsics": [{"a": 1}], "K": "x"}',
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_hostile_files_are_refused_in_one_line(tmp_path: Path, text: str) -> None:
    assert len(refusal(write(tmp_path, text), size=SIZE)) < 600  # the bombs would take minutes, and gigabytes


def test_a_large_array_in_an_archive_is_not_read(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "c.npz", K=np.array(MATRIX), D=np.zeros(5), images=np.zeros((3000, 3000)))
    assert load_camera(tmp_path / "c.npz", size=SIZE).fx == 800


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("#polynomial coefficients for the DIRECT mapping function (ocam_model.ss)\n5 -1e2 0 1e-3\n", "OCamCalib"),
        ('{"value0": {"intrinsics": [{"camera_type": "ds", "intrinsics": {"fx": 349}}]}}', "Basalt"),
        ("# Bundle file v0.3\n1 0\n800 0 0\n", "Bundler"),
        (
            "fileName imageWidth imageHeight\ncamera matrix K [3x3]\n\na.JPG 5472 3648\n3647 0 2736\n",
            "camera_parameters.cam",
        ),
        ("<BlocksExchange><Block><FocalLength>8.8</FocalLength></Block></BlocksExchange>", "ContextCapture"),
        ('<x:x xmlns:x="a" xmlns:xcr="b"><x:d xcr:FocalLength35mm="24"/></x:x>', "RealityCapture"),
        ("<ExportAPERO><CalibrationInternConique><F>3650</F></CalibrationInternConique></ExportAPERO>", "MicMac"),
        ("Model = CAHVOR = perspective, distortion\nDimensions = 1024 1024\n", ".cahvor file"),
        ("<sdf><camera><horizontal_fov>1.047</horizontal_fov></camera></sdf>", "--fov takes its horizontal_fov"),
        ('{"FocalLength": 16, "SensorWidth": 23.5, "ImageWidth": 6000}', "px = mm x image width in px / sensor width"),
        ('{"focal_length": 16, "sensor_size_h": 23.5, "resolution_h": 6000}', "px = mm x image width in px / sensor"),
        ('{"graph": {"CameraInit_1": {"nodeType": "CameraInit"}}}', "Meshroom graph"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "PNG image; --camera exif takes"),
    ],
)
def test_what_is_not_read_is_named(tmp_path: Path, content: str | bytes, words: str) -> None:
    message = refusal(write(tmp_path, content))
    assert words in message.partition("looks like")[2]
