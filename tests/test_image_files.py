"""Images as other programs write and damage them: the right picture is read, or the file is refused by name."""

from __future__ import annotations

import io
import os
import re
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image as PillowImage

from slopecli.errors import InputError
from slopecli.io import load_image
from slopecli.types import Image

GROUND = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 1, (96, 128)), (0, 0), 2)
GREY = cv2.normalize(GROUND, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
COLOUR = np.dstack([GREY, 255 - GREY, GREY // 2])
DEEP = GREY.astype(np.uint16) * 4 + 300


def load(folder: Path, data: bytes) -> Image:
    path = folder / "image"
    path.write_bytes(data)
    return load_image(path)


def refusal(folder: Path, data: bytes) -> str:
    with pytest.raises(InputError) as caught:
        load(folder, data)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    return message


def encoded(suffix: str, pixels: np.ndarray, *parameters: int) -> bytes:
    return cv2.imencode(suffix, pixels, parameters)[1].tobytes()


def saved(picture: PillowImage.Image, kind: str, **options: Any) -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, kind, **options)
    return buffer.getvalue()


def tiff(*pages: np.ndarray, kinds: tuple[int, ...] = (), **options: Any) -> bytes:
    buffer = io.BytesIO()
    with tifffile.TiffWriter(buffer, bigtiff=options.pop("bigtiff", False)) as file:
        for n, page in enumerate(pages):
            file.write(page, subfiletype=kinds[n] if kinds else 0, metadata=None, contiguous=False, **options)
    return buffer.getvalue()


def likeness(image: Image, wanted: np.ndarray = GREY) -> float:
    return float(np.corrcoef(image.grey.ravel(), wanted.ravel())[0, 1])


# ---- the range of deep pixels ----


def with_spots(values: np.ndarray, share: float, spot: float, seed: int = 1) -> np.ndarray:
    spotted = values.copy()
    spotted[np.random.default_rng(seed).random(values.shape) < share] = spot
    return spotted


@pytest.mark.parametrize(
    ("share", "spot"), [(0.004, 65535), (0.03, 65535), (0.3, 65535), (0.3, 0), (0.04, 30000), (0.0005, 65535)]
)
def test_glints_and_missing_pixels_do_not_take_the_contrast(tmp_path: Path, share: float, spot: int) -> None:
    pixels = with_spots(DEEP, share, spot)
    image = load(tmp_path, encoded(".png", pixels))
    ground = pixels != spot
    assert image.grey[ground].std() > 0.4 * GREY.std()
    assert np.all(image.grey[~ground] == (255 if spot else 0))
    assert "mapped to 0..255" in image.note


@pytest.mark.parametrize("missing", [-9999.0, -32768.0, 3.4e38, -3.4028234663852886e38, np.nan, np.inf])
@pytest.mark.parametrize("share", [0.002, 0.4])
def test_missing_values_of_float_images(tmp_path: Path, missing: float, share: float) -> None:
    pixels = with_spots(DEEP.astype(np.float32), share, missing)
    image = load(tmp_path, tiff(pixels))
    ground = np.isfinite(pixels) & (pixels != np.float32(missing))
    assert image.grey[ground].std() > 0.9 * GREY.std()


@pytest.mark.parametrize("kind", [np.uint16, np.int16, np.float32, np.float64])
def test_the_nodata_value_of_gdal_is_left_out(tmp_path: Path, kind: type) -> None:
    pixels = with_spots(DEEP.astype(kind), 0.3, 7)
    pixels[:9, :20] = 3  # not the least value that occurs, so only its tag tells
    image = load(tmp_path, tiff(pixels, extratags=[(42113, 2, 0, "7\0", False)]))
    ground = (pixels != 7) & (pixels != 3)
    assert np.all(image.grey[pixels == 7] == 0)
    assert image.grey[ground].std() > 0.8 * GREY.std()


def test_the_nodata_value_of_colour_images(tmp_path: Path) -> None:
    pixels = np.dstack([DEEP, DEEP + 100, DEEP + 200]).astype(np.float32)
    pixels[:40, :40] = -9999
    image = load(tmp_path, tiff(pixels, photometric="rgb", extratags=[(42113, 2, 0, "-9999\0", False)]))
    assert image.colour is not None
    assert not image.colour[:40, :40].any()
    assert image.grey[40:].std() > 0.6 * GREY.std()


def test_the_share_outside_the_range_is_said_when_it_is_not_small(tmp_path: Path) -> None:
    assert "2 % of the pixels are outside" in re.sub(
        r"[12]\.\d %", "2 %", load(tmp_path, tiff(with_spots(DEEP, 0.02, 65535))).note
    )
    assert "outside" not in load(tmp_path, tiff(DEEP)).note


def test_a_tenth_of_the_picture_far_brighter_keeps_its_structure(tmp_path: Path) -> None:
    pixels = DEEP.copy()
    pixels[:10] += 20000
    assert load(tmp_path, tiff(pixels)).grey[:10].std() > 1


def test_float64_beyond_float32_is_read_without_a_warning(tmp_path: Path) -> None:
    pixels = with_spots(DEEP.astype(np.float64), 0.01, 1e300)
    assert load(tmp_path, tiff(pixels)).grey.std() > 30


# ---- TIFF: which image, which bands ----


@pytest.mark.parametrize("bigtiff", [False, True])
@pytest.mark.parametrize("kinds", [(1, 0), (0, 0)])
def test_the_full_image_is_read_and_not_a_thumbnail_before_it(
    tmp_path: Path, kinds: tuple[int, ...], bigtiff: bool
) -> None:
    image = load(tmp_path, tiff(GREY[::4, ::4], GREY, kinds=kinds, bigtiff=bigtiff))
    assert np.array_equal(image.grey, GREY)
    assert ("holds 2 images; the largest (128x96 px) is used" in image.note) == (kinds == (0, 0))


def test_overviews_after_the_image_need_no_note(tmp_path: Path) -> None:
    image = load(tmp_path, tiff(GREY, GREY[::2, ::2], GREY[::4, ::4], kinds=(0, 1, 1)))
    assert np.array_equal(image.grey, GREY)
    assert image.note == ""


def test_a_full_image_below_its_thumbnail_is_found(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with tifffile.TiffWriter(buffer) as file:
        file.write(GREY[::4, ::4], subfiletype=1, subifds=1, metadata=None)
        file.write(GREY, metadata=None)
    assert np.array_equal(load(tmp_path, buffer.getvalue()).grey, GREY)


def test_pages_of_one_size_are_said(tmp_path: Path) -> None:
    image = load(tmp_path, tiff(GREY, 255 - GREY))
    assert np.array_equal(image.grey, GREY)
    assert "holds 2 images; the first is used" in image.note


def test_a_turned_full_image_after_its_thumbnail(tmp_path: Path) -> None:
    turned = [(274, 3, 1, 6, False)]
    image = load(tmp_path, tiff(GREY[::4, ::4], GREY, kinds=(1, 0), extratags=turned))
    assert np.array_equal(image.grey, GREY)
    assert "turned by 90 degrees clockwise" in image.note


@pytest.mark.parametrize("bands", [5, 6, 12])
@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_the_number_of_bands_is_named(tmp_path: Path, bands: int, planar: str, kind: type) -> None:
    pixels = np.dstack([GREY] * bands).astype(kind)
    pixels = np.ascontiguousarray(pixels.transpose(2, 0, 1)) if planar == "separate" else pixels
    assert f"{bands} bands" in refusal(tmp_path, tiff(pixels, photometric="minisblack", planarconfig=planar))


@pytest.mark.parametrize("tile", [None, (32, 32)])
def test_bands_one_after_the_other_are_read_or_refused_but_not_mixed_up(tmp_path: Path, tile: Any) -> None:
    for kind in (np.uint8, np.uint16, np.float32):
        bands = np.ascontiguousarray(COLOUR.transpose(2, 0, 1)).astype(kind)
        data = tiff(bands, photometric="rgb", planarconfig="separate", tile=tile)
        if kind == np.uint8:
            assert np.array_equal(load(tmp_path, data).colour, COLOUR[..., ::-1])
        else:
            assert "planar" in refusal(tmp_path, data)


def test_kinds_of_values_and_compression_are_named(tmp_path: Path) -> None:
    assert "complex" in refusal(tmp_path, tiff(GREY.astype(np.complex64)))
    assert "floating-point values of 16 bits" in refusal(tmp_path, tiff(GREY.astype(np.float16)))
    assert "LZMA" in refusal(tmp_path, tiff(GREY, compression="lzma"))


@pytest.mark.parametrize("start", [b"II+\0\x08\0\0\0" + b"\xf8" + b"\xff" * 7, b"II+\0\x08\0\0\0" + b"\xff" * 8])
def test_offsets_beyond_every_file(tmp_path: Path, start: bytes) -> None:
    refusal(tmp_path, start + bytes(64))
    data = encoded(".jpg", GREY)
    segment = b"\xff\xe1" + struct.pack(">H", len(start) + 16) + b"Exif\0\0" + start + bytes(8)
    assert load(tmp_path, data[:2] + segment + data[2:]).width == 128


def test_directories_that_lead_back_to_themselves(tmp_path: Path) -> None:
    data = bytearray(tiff(GREY))
    count = struct.unpack_from("<H", data, 8)[0]
    struct.pack_into("<I", data, 10 + 12 * count, 8)
    assert np.array_equal(load(tmp_path, bytes(data)).grey, GREY)


# ---- other kinds ----


@pytest.mark.parametrize("orientation", [2, 3, 4, 5, 6, 7, 8])
def test_orientation_of_webp_is_told_and_not_applied(tmp_path: Path, orientation: int) -> None:
    exif = PillowImage.Exif()
    exif[274] = orientation
    image = load(tmp_path, saved(PillowImage.fromarray(COLOUR), "WEBP", lossless=True, exif=exif))
    assert np.array_equal(image.colour, COLOUR[..., ::-1])
    assert "not applied" in image.note


@pytest.mark.parametrize("kind", ["GIF", "WEBP", "PNG"])
def test_an_animation_is_said(tmp_path: Path, kind: str) -> None:
    pictures = [PillowImage.fromarray(values) for values in (GREY, 255 - GREY)]
    image = load(tmp_path, saved(pictures[0], kind, save_all=True, append_images=pictures[1:]))
    assert likeness(image) > 0.95
    assert "animated; its first picture is used" in image.note
    assert load(tmp_path, saved(pictures[0], kind)).note == ""


@pytest.mark.parametrize("mode", ["1", "P", "LA", "RGBA", "CMYK", "L", "I;16"])
def test_modes_of_pillow(tmp_path: Path, mode: str) -> None:
    picture = PillowImage.fromarray(DEEP) if mode == "I;16" else PillowImage.fromarray(GREY).convert(mode)
    for kind in ("PNG", "TIFF", "JPEG", "BMP", "WEBP"):
        try:
            data = saved(picture, kind)
        except OSError:
            continue  # the format does not have this mode
        assert load(tmp_path, data).grey.shape == GREY.shape, (mode, kind)


@pytest.mark.parametrize(
    ("start", "name"),
    [
        (b"\0\0\0\x18ftypheic", "a HEIC"),
        (b"\0\0\0\x18ftypmif1", "a HEIC"),
        (b"\0\0\0\x20ftypisom", "a video"),
        (b"\xff\x0a", "a JPEG XL"),
        (b"%PDF-1.7", "a PDF"),
        (b"\x93NUMPY", "a NumPy"),
        (b"PK\x03\x04", "a ZIP"),
        (b"\x1f\x8b", "a gzip"),
        (b"qoif", "a QOI"),
    ],
)
def test_other_kinds_of_files_are_named(tmp_path: Path, start: bytes, name: str) -> None:
    assert f"is {name} file" in refusal(tmp_path, start + bytes(100))


@pytest.mark.parametrize(
    "start",
    [
        b"BM" + bytes(16) + struct.pack("<ii", 40000, -40000) + bytes(60),
        b"P5\n# by hand\n40000 40000\n255\n" + bytes(60),
        b"Pf\n40000 40000\n-1.0\n" + bytes(60),
        b"P7\nWIDTH 40000\nHEIGHT 40000\nDEPTH 1\nMAXVAL 255\nTUPLTYPE GRAYSCALE\nENDHDR\n" + bytes(60),
        b"GIF89a" + struct.pack("<HH", 40000, 40000) + bytes(60),
        b"\x59\xa6\x6a\x95" + struct.pack(">II", 40000, 40000) + bytes(60),
        b"\xff\x4f\xff\x51" + bytes(4) + struct.pack(">IIII", 40000, 40000, 0, 0) + bytes(60),
        b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(20) + b"ihdr" + struct.pack(">II", 40000, 40000) + bytes(60),
        b"RIFF" + struct.pack("<I", 22) + b"WEBPVP8X" + struct.pack("<I", 10) + bytes(4) + b"\x3f\x9c\0" * 2,
    ],
)
def test_absurd_sizes_are_refused_before_memory_is_taken(tmp_path: Path, start: bytes) -> None:
    assert "40000x40000 px, more than" in refusal(tmp_path, start)


def test_long_whitespace_in_a_header_takes_no_time(tmp_path: Path) -> None:
    for start in (b"P5" + b" " * 5000 + b"x", b"P7\n" + b"A\n" * 5000):
        assert "of a kind that cannot be read" in refusal(tmp_path, start)


# ---- damage that decoders report ----


@pytest.mark.parametrize("progressive", [0, 1])
@pytest.mark.parametrize("restart", [0, 4])
def test_a_jpeg_with_damage_in_the_middle_is_refused(
    tmp_path: Path, progressive: int, restart: int, capfd: pytest.CaptureFixture[str]
) -> None:
    options = (cv2.IMWRITE_JPEG_PROGRESSIVE, progressive, cv2.IMWRITE_JPEG_RST_INTERVAL, restart)
    data = encoded(".jpg", COLOUR, *options)
    half = len(data) // 2
    noise = np.random.default_rng(2).bytes(60)
    damaged = [data[:half] + b"\xff\xd9", data[:half] + data[half + 401 :]]
    damaged += [data[:half] + noise + data[half + 60 :]] if not progressive else []
    for content in damaged:
        assert "damaged" in refusal(tmp_path, content)
    assert load(tmp_path, data).note == ""
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("compression", ["tiff_lzw", "jpeg", "tiff_deflate"])
def test_a_tiff_with_damaged_strips_is_refused(
    tmp_path: Path, compression: str, capfd: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(saved(PillowImage.fromarray(COLOUR), "TIFF", compression=compression))
    load(tmp_path, bytes(data))
    middle = len(data) // 2
    data[middle : middle + 50] = np.random.default_rng(0).bytes(50)
    assert "damaged" in refusal(tmp_path, bytes(data))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("lossless", [False, True])
def test_a_webp_that_is_not_whole_is_refused(tmp_path: Path, lossless: bool) -> None:
    data = saved(PillowImage.fromarray(np.dstack([COLOUR] * 2)[..., :3].repeat(3, 0)), "WEBP", lossless=lossless)
    half = len(data) // 2
    assert "cut short" in refusal(tmp_path, data[:half])
    assert "cut short" in refusal(tmp_path, data[:-1])
    assert "cut short" in refusal(tmp_path, data[:4] + struct.pack("<I", half - 8) + data[8:half])
    assert "ends in zeros" in refusal(tmp_path, data[:half] + bytes(len(data) - half))
    assert load(tmp_path, data + b"trailer").width == 128


def test_a_png_that_lacks_a_piece_is_refused_with_the_reason(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    def png(rows: bytes) -> bytes:
        chunks = [
            (b"IHDR", struct.pack(">IIBBBBB", 128, 96, 8, 0, 0, 0, 0)),
            (b"IDAT", zlib.compress(rows)),
            (b"IEND", b""),
        ]
        parts = [struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c)) for k, c in chunks]
        return b"\x89PNG\r\n\x1a\n" + b"".join(parts)

    rows = b"".join(b"\0" + row.tobytes() for row in GREY)
    assert np.array_equal(load(tmp_path, png(rows)).grey, GREY)
    assert "damaged" in refusal(tmp_path, png(rows[:6000]))
    assert capfd.readouterr() == ("", "")


def test_what_others_say_on_stderr_meanwhile_is_passed_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    real = cv2.imdecode

    def talkative(*arguments: Any) -> Any:
        os.write(2, b"another thread\nlibpng warning: iCCP\n")
        return real(*arguments)

    monkeypatch.setattr(cv2, "imdecode", talkative)
    load(tmp_path, encoded(".png", GREY))
    assert capfd.readouterr().err == "another thread\n"


def test_without_stderr_images_are_read(tmp_path: Path) -> None:
    kept = os.dup(2)
    os.close(2)
    try:
        assert load(tmp_path, encoded(".jpg", GREY)).width == 128
    finally:
        os.dup2(kept, 2)
        os.close(kept)
