"""A good file of every format that the program reads, small, so that an input takes little time."""

from __future__ import annotations

import ast
import io
import json
import struct
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import camera_factory
import cv2
import numpy as np
import scipy.io
from PIL import Image as PilImage

from slopecli.products import OUTPUT_NAMES

SAMPLE_DATA = Path(__file__).resolve().parents[2] / "sample_data"
DESCENT = SAMPLE_DATA / "descent"
SIDE = 96  # px: a window of that size still has an answer
SMALL = 64  # px: it has none, at a fifth of the time
FEW_PATCHES, FEW_ROWS = ("1", "9"), 8  # of the sample correspondences: an answer at a ninth of the time
POSE = {"R": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "T": [0.5, 0.1, 1.0]}
OPENCV_POSE = {**POSE, "t": [[-0.5], [-0.1], [-1.0]]}
OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<image_Width>1024</image_Width><image_Height>768</image_Height>
<Camera_Matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>800. 0. 511.5 0. 810. 383.5 0. 0. 1.</data></Camera_Matrix>
<Distortion_Coefficients type_id="opencv-matrix"><rows>5</rows><cols>1</cols><dt>d</dt>
<data>-0.28 0.074 0.0002 1e-05 0.</data></Distortion_Coefficients>
</opencv_storage>
"""


@cache
def view(number: int, side: int = SIDE) -> np.ndarray:
    """Image 1 or 2 of the sample pair made small, (side, side, 3) uint8."""
    whole = cv2.imread(str(DESCENT / f"image{number}.png"), cv2.IMREAD_COLOR)
    return cv2.resize(whole, (side, side), interpolation=cv2.INTER_AREA)


@cache
def pair(side: int = SIDE, few: bool = False) -> dict[str, bytes]:
    """The two images, their camera and correspondences, all or a few, as files."""
    return {
        "image1.png": encoded(".png", view(1, side)),
        "image2.png": encoded(".png", view(2, side)),
        "camera.json": (DESCENT / "camera.json").read_bytes(),
        "matches.csv": _few_matches() if few else (SAMPLE_DATA / "matches.csv").read_bytes(),
    }


def _few_matches() -> bytes:
    header, *rows = (SAMPLE_DATA / "matches.csv").read_text().splitlines()
    few = [row for patch in FEW_PATCHES for row in [row for row in rows if row.endswith(f",{patch}")][:FEW_ROWS]]
    return "\n".join([header, *few, ""]).encode()


def encoded(suffix: str, pixels: np.ndarray, *options: int) -> bytes:
    """The bytes of an image file."""
    done, data = cv2.imencode(suffix, pixels, options)
    assert done
    return data.tobytes()


@cache
def camera_texts() -> list[str]:
    """Camera files that are text: those of camera_factory and of the formats' tests, and what these have none of."""
    found = [value for name, value in vars(camera_factory).items() if name.isupper() and isinstance(value, str | dict)]
    texts = [value if isinstance(value, str) else json.dumps(value) for value in found]
    texts += [content if isinstance(content, str) else json.dumps(content) for content, _ in _sample_pairs()]
    native = {"width": 1024, "height": 1024, "K": camera_factory.MATRIX, "distortion": [0.1, 0.0, 0.0, 0.0]}
    return list(dict.fromkeys([*texts, *_of_tests(), json.dumps(native), OPENCV_XML, frames_text()]))


def _of_tests() -> list[str]:
    """The texts that tests/test_camera_<module>.py call SAMPLE, so that a new format touches no other test."""
    tests = sorted(Path(__file__).resolve().parent.parent.glob("test_camera_*.py"))
    lines = (node for path in tests for node in ast.parse(path.read_text(encoding="utf-8")).body)
    return [
        ast.literal_eval(node.value)
        for node in lines
        if isinstance(node, ast.Assign)
        and ast.unparse(node.targets[0]) == "SAMPLE"
        and isinstance(node.value, ast.Constant)
    ]


def _sample_pairs() -> list[tuple[Any, str]]:
    return [pair for pair in camera_factory.SAMPLES.values() if isinstance(pair[0], str | dict)]


def frames_text() -> str:
    """nerfstudio's transforms.json with a camera a frame."""
    frames = [{**camera_factory.NERFSTUDIO, "file_path": f"cam{k}/image{k}.png"} for k in (1, 2)]
    return json.dumps({"frames": [{key: value for key, value in one.items() if key != "frames"} for one in frames]})


@cache
def camera_binaries() -> list[bytes]:
    """Camera files that are not text: of COLMAP, NumPy and MATLAB, images with a label; those of camera_factory too."""
    found = [content for content, _ in camera_factory.SAMPLES.values() if isinstance(content, bytes)]
    arrays = [_numpy_array(np.array(camera_factory.MATRIX)), _matlab_file()]
    images = [text.encode() + bytes(200) for text in (camera_factory.PDS3, camera_factory.VICAR)]
    return [*found, colmap_binary(), numpy_archive(), *arrays, *images]


def _matlab_file() -> bytes:
    """Bouguet's Calib_Results.mat; SciPy writes the time into its header, which is taken out."""
    file = io.BytesIO()
    variables = {"fc": [[800.0], [810.0]], "cc": [[511.5], [383.5]], "kc": [[-0.2], [0.1], [0.0], [0.0], [0.0]]}
    scipy.io.savemat(file, {**variables, "nx": 1024, "ny": 768}, do_compression=True)
    return b"MATLAB 5.0 MAT-file".ljust(116) + file.getvalue()[116:]


def colmap_binary() -> bytes:
    opencv = struct.pack("<IiQQ8d", 1, 4, 1024, 768, 800, 810, 512, 384, -0.28, 0.074, 0.0002, 1e-05)
    pinhole = struct.pack("<IiQQ4d", 7, 1, 1024, 1024, 800, 800, 512, 512)
    return struct.pack("<Q", 2) + opencv + pinhole


def numpy_archive(**arrays: Any) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **{"mtx": camera_factory.MATRIX, "dist": [list(camera_factory.BROWN)], **arrays})
    return file.getvalue()


@cache
def camera_bombs() -> list[bytes]:
    """Small camera files that take much time, memory or depth if they are believed."""
    native = json.dumps(camera_factory.NATIVE)
    aliases = "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))
    mappings = "".join(f"m{k}: &m{k} {{{', '.join(f'{c}: *m{k - 1}' for c in 'abcdefghi')}}}\n" for k in range(1, 12))
    merges = "".join(f"n{k}: &n{k}\n  <<: [*n{k - 1}, *n{k - 1}]\n" for k in range(1, 25))
    entities = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 12))
    texts = [
        f"a0: &a0 [1]\n{aliases}distortion: *a11\n{ROS}",
        f"a0: &a0 [1]\n{aliases}K: *a11\nwidth: 1024\nheight: 1024\n",
        f"m0: &m0 {{a: 1}}\n{mappings}fx: *m11\n",
        f"n0: &n0 {{a: 1}}\n{merges}fx: *n24\n",
        "a: &a [*a]\nfx: *a\n",
        "&a {fx: *a, fy: *a, cx: 1, cy: 1, width: 9, height: 9}",
        f'<!DOCTYPE x [<!ENTITY e0 "ha">{entities}]><opencv_storage><K>&e11;</K></opencv_storage>',
        *(f"{start * depth}1{end * depth}" for depth in (900, 100_000) for start, end in ("[]", ('{"a":', "}"))),
        *(f'{{"K": {"[" * depth}1{"]" * depth}, "width": 9, "height": 9}}' for depth in (100, 900, 3000)),
        "K: " + "[" * 5000 + "1" + "]" * 5000,
        "".join("  " * k + f"k{k}:\n" for k in range(600)) + "  " * 600 + "1",
        "<a>" * 20_000 + "</a>" * 20_000,
        *(
            native.replace("800", number)
            for number in ("9" * 400, "9" * 5000, "1e999", "-" * 5000, "[" + "1," * 9999 + "1]")
        ),
        native.replace('"fx": 800', '"fx": 800, "fx": 400'),
        "width: 9\nwidth: 10\nfx: 1\nfx: 2\n",
        "1 PINHOLE 1024 1024 800 800 512 512\n" * 3,
        "fx: 1\n" * 100_000,
        "\n" * 100_000,
        "- " * 20_000,
        "? " * 5000,
        "{" * 5000,
        "a: " * 5000,
        "&a " * 5000,
        '"' + "a" * 1_000_000,
        "#" * 1_000_000,
    ]
    return [text.encode() for text in texts] + [numpy_claim(shape) for shape in ((10**9,), (2**40, 3, 3), (0, 2**62))]


ROS = camera_factory.ROS_FILE.split("distortion_coefficients")[0]


@cache
def truths() -> dict[str, bytes]:
    """Known ground in the forms that `validate` reads, of the size of the pair: a slope, and points on it."""
    v, u = np.mgrid[: view(1).shape[0], : view(1).shape[1]].astype(np.float32)
    depth = 8.0 + 0.004 * u + 0.002 * v
    points = np.column_stack([(u * depth / 700.0 - 4.0).ravel(), (v * depth / 700.0 - 4.0).ravel(), depth.ravel()])[
        ::97
    ]
    archive, cloud = io.BytesIO(), points.astype("<f4")
    np.savez_compressed(archive, depth=depth, mask=depth > 9)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(cloud)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    height, width = depth.shape
    return {
        "depth.npy": _numpy_array(depth),
        "depth.npz": archive.getvalue(),
        "depth.pfm": f"Pf\n{width} {height}\n-1.0\n".encode() + depth[::-1].astype("<f4").tobytes(),
        "depth.png": encoded(".png", np.rint(1000.0 * depth).astype(np.uint16)),
        "cloud.ply": header.encode() + cloud.tobytes(),
        "cloud.npy": _numpy_array(points),
    }


def numpy_claim(shape: tuple[int, ...]) -> bytes:
    """A NumPy archive whose array says that it is of this shape, and is short; of one shape, all zeros and whole."""
    file = io.BytesIO()
    header = repr({"descr": "<f8", "fortran_order": False, "shape": shape}).encode().ljust(117) + b"\n"
    whole = 8 * shape[0] if len(shape) == 1 else 72
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("K.npy", "w") as member,
    ):
        member.write(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
        for _ in range(0, min(whole, 200_000_000), 1_000_000):
            member.write(bytes(1_000_000))
    return file.getvalue()


@cache
def images(side: int = SIDE) -> dict[str, bytes]:
    """Image files of every kind that is read, by a name with their suffix."""
    colour = view(1, side)
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    deep = (colour.astype(np.uint16) << 8) + 77
    real = colour.astype(np.float32) / 255
    alpha = np.dstack([colour, np.full_like(grey, 200)])
    found = {
        "colour.png": encoded(".png", colour),
        "grey.png": encoded(".png", grey),
        "deep.png": encoded(".png", deep),
        "alpha.png": encoded(".png", alpha),
        "colour.jpg": encoded(".jpg", colour),
        "progressive.jpg": encoded(".jpg", colour, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        "restarts.jpg": encoded(".jpg", colour, cv2.IMWRITE_JPEG_RST_INTERVAL, 4),
        "grey.jpg": encoded(".jpg", grey),
        "colour.tif": encoded(".tif", colour),
        "deep.tif": encoded(".tif", deep),
        "plain.tif": encoded(".tif", grey, cv2.IMWRITE_TIFF_COMPRESSION, 1),
        "real.tif": encoded(".tif", real),
        "lossy.webp": encoded(".webp", colour, cv2.IMWRITE_WEBP_QUALITY, 80),
        "lossless.webp": encoded(".webp", colour, cv2.IMWRITE_WEBP_QUALITY, 101),
        "colour.bmp": encoded(".bmp", colour),
        "colour.ppm": encoded(".ppm", colour),
        "deep.pgm": encoded(".pgm", deep[..., 0]),
        "ascii.pgm": encoded(".pgm", grey, cv2.IMWRITE_PXM_BINARY, 0),
        "colour.jp2": encoded(".jp2", colour),
        "array.npy": _numpy_array(grey),
        "camera.npz": numpy_archive(),
    }
    return found | _tagged(colour)


def _tagged(colour: np.ndarray) -> dict[str, bytes]:
    """Images with EXIF tags: an orientation, and what cameras write."""
    picture, found = PilImage.fromarray(colour[..., ::-1].copy()), {}
    exif = PilImage.Exif()
    exif[274], exif[271], exif[305] = 6, "maker", "software"
    exif.get_ifd(0x8769)[37386] = 4.5
    exif.get_ifd(0x8769)[41989] = 28
    for name in ("exif.jpg", "exif.png", "exif.webp", "exif.tif"):
        file = io.BytesIO()
        picture.save(file, {"jpg": "JPEG", "tif": "TIFF"}.get(name[-3:], name.split(".")[1].upper()), exif=exif)
        found[name] = file.getvalue()
    return found


def exif_block() -> bytes:
    """The TIFF structure of EXIF tags."""
    exif = PilImage.Exif()
    exif[274], exif[271] = 8, "maker"
    return exif.tobytes().removeprefix(b"Exif\0\0")


def _numpy_array(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def outputs_of(tree: dict[str, bytes]) -> list[str]:
    """Paths of the outputs among files by path."""
    return [path for path in tree if Path(path).name in OUTPUT_NAMES]
