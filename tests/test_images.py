"""Reading images: every kind of pixel, orientation left alone, and one clear line for what cannot be used."""

import hashlib
import io
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from slopecli.errors import InputError
from slopecli.io import MAX_PIXELS, load_image
from slopecli.types import Image

COLOUR = np.random.default_rng(3).integers(0, 256, (40, 64, 3), dtype=np.uint8)  # BGR
GREY = COLOUR[..., 0]


def encoded(suffix: str, pixels: np.ndarray) -> bytes:
    return cv2.imencode(suffix, pixels)[1].tobytes()


def load(folder: Path, name: str, data: bytes) -> Image:
    path = folder / name
    path.write_bytes(data)
    return load_image(path)


def refusal(folder: Path, name: str, data: bytes) -> str:
    with pytest.raises(InputError) as caught:
        load(folder, name, data)
    message = str(caught.value)
    assert name in message
    assert "\n" not in message
    return message


def test_8_bit_colour_is_untouched(tmp_path: Path) -> None:
    data = encoded(".png", COLOUR)
    image = load(tmp_path, "a.png", data)
    assert np.array_equal(image.colour, COLOUR)
    assert np.array_equal(image.grey, cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY))
    assert (image.width, image.height) == (64, 40)
    assert image.sha256 == hashlib.sha256(data).hexdigest()
    assert image.path == str(tmp_path / "a.png")
    assert image.note == ""


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".pgm"])
def test_8_bit_grey_is_untouched(tmp_path: Path, suffix: str) -> None:
    image = load(tmp_path, f"a{suffix}", encoded(suffix, GREY))
    assert np.array_equal(image.grey, GREY)
    assert image.colour is None


def test_alpha_is_dropped(tmp_path: Path) -> None:
    image = load(tmp_path, "a.png", encoded(".png", np.dstack([COLOUR, GREY])))
    assert np.array_equal(image.colour, COLOUR)
    assert np.array_equal(image.grey, cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY))


def test_palette_and_grey_with_alpha_are_read(tmp_path: Path) -> None:
    for mode in ("P", "LA", "1"):
        buffer = io.BytesIO()
        PillowImage.fromarray(COLOUR).convert(mode).save(buffer, "PNG")
        assert load(tmp_path, f"{mode}.png", buffer.getvalue()).grey.shape == (40, 64)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_16_bit_is_stretched_in_order(tmp_path: Path, suffix: str) -> None:
    deep = np.arange(40 * 64, dtype=np.uint16).reshape(40, 64) * 3 + 20000
    image = load(tmp_path, f"deep{suffix}", encoded(suffix, deep))
    assert image.grey.dtype == np.uint8
    assert np.all(np.diff(image.grey.ravel().astype(int)) >= 0)
    assert (image.grey.min(), image.grey.max()) == (0, 255)
    assert len(np.unique(image.grey)) == 256
    assert "uint16" in image.note


def test_one_hot_pixel_does_not_blacken_a_16_bit_image(tmp_path: Path) -> None:
    deep = np.random.default_rng(1).integers(900, 1100, (200, 200)).astype(np.uint16)
    deep[5, 5] = 65535
    grey = load(tmp_path, "hot.png", encoded(".png", deep)).grey
    assert grey.std() > 50


def test_channels_of_16_bit_colour_keep_their_balance(tmp_path: Path) -> None:
    deep = COLOUR.astype(np.uint16) * 100 + 5000
    image = load(tmp_path, "deep.png", encoded(".png", deep))
    assert image.colour is not None
    middle = (image.grey > 20) & (image.grey < 235)
    found = cv2.cvtColor(image.colour, cv2.COLOR_BGR2GRAY)
    inside = middle & (image.colour.min(axis=2) > 0) & (image.colour.max(axis=2) < 255)
    assert np.abs(found[inside].astype(int) - image.grey[inside]).max() <= 1


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int16, np.int8])
def test_other_tiff_depths_are_stretched(tmp_path: Path, kind: type) -> None:
    ramp = np.tile(np.linspace(-100, 100, 64), (40, 1)).astype(kind)
    grey = load(tmp_path, "a.tif", encoded(".tif", ramp)).grey
    assert np.all(np.diff(grey.astype(int), axis=1) >= 0)
    assert (grey.min(), grey.max()) == (0, 255)


def test_float_with_nan_and_infinity(tmp_path: Path) -> None:
    ramp = np.tile(np.linspace(0, 1, 64, dtype=np.float32), (40, 1))
    ramp[0, :3] = np.nan, np.inf, -np.inf
    grey = load(tmp_path, "a.tif", encoded(".tif", ramp)).grey
    assert list(grey[0, :3]) == [0, 255, 0]
    assert grey[1:, -1].min() == 255


def test_float_without_one_finite_value_is_refused(tmp_path: Path) -> None:
    assert "finite" in refusal(tmp_path, "a.tif", encoded(".tif", np.full((40, 64), np.nan, np.float32)))


def test_a_flat_deep_image_is_read(tmp_path: Path) -> None:
    assert load(tmp_path, "a.png", encoded(".png", np.full((40, 64), 700, np.uint16))).grey.max() == 0


@pytest.mark.parametrize("orientation", [2, 3, 4, 5, 6, 7, 8])
@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF"])
def test_exif_orientation_is_told_and_not_applied(tmp_path: Path, kind: str, orientation: int) -> None:
    exif, plain, turned = PillowImage.Exif(), io.BytesIO(), io.BytesIO()
    exif[274] = orientation
    picture = PillowImage.fromarray(COLOUR[..., ::-1])
    picture.save(plain, kind)
    picture.save(turned, kind, exif=exif)
    image = load(tmp_path, "turned", turned.getvalue())
    assert np.array_equal(image.grey, load(tmp_path, "plain", plain.getvalue()).grey)
    assert "not applied" in image.note
    assert "\n" not in image.note


def test_upright_orientation_needs_no_note(tmp_path: Path) -> None:
    exif, buffer = PillowImage.Exif(), io.BytesIO()
    exif[274] = 1
    PillowImage.fromarray(COLOUR).save(buffer, "JPEG", exif=exif)
    assert load(tmp_path, "a.jpg", buffer.getvalue()).note == ""


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.png: no such image file"):
        load_image(tmp_path / "none.png")


def test_unusable_path(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_image(tmp_path / ("x" * 5000))


def test_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is a folder, needed an image file$"):
        load_image(tmp_path)


def test_device() -> None:
    with pytest.raises(InputError, match="not a regular file"):
        load_image("/dev/zero")


def test_empty_file(tmp_path: Path) -> None:
    assert "empty" in refusal(tmp_path, "a.png", b"")


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".bmp", ".webp", ".ppm", ".jp2"])
@pytest.mark.parametrize("kept", [0.02, 0.3, 0.5, 0.95])
def test_a_file_cut_short_is_refused(tmp_path: Path, suffix: str, kept: float, capfd: pytest.CaptureFixture) -> None:
    data = encoded(suffix, COLOUR)
    refusal(tmp_path, f"cut{suffix}", data[: int(kept * len(data))])
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_the_last_bytes_matter(tmp_path: Path, suffix: str) -> None:
    data = encoded(suffix, COLOUR)
    assert "cut short" in refusal(tmp_path, f"cut{suffix}", data[:-2])
    refusal(tmp_path, f"zeros{suffix}", data[: len(data) // 2] + bytes(len(data) // 2))


def test_a_tiff_whose_pixels_end_early_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    buffer = io.BytesIO()
    PillowImage.fromarray(COLOUR).save(buffer, "TIFF")  # directory first, pixels last
    refusal(tmp_path, "a.tif", buffer.getvalue()[:-100])
    assert capfd.readouterr() == ("", "")


def test_a_jpeg_cut_after_a_whole_thumbnail_is_refused(tmp_path: Path) -> None:
    thumbnail, data = encoded(".jpg", COLOUR), encoded(".jpg", COLOUR)
    segment = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 8) + b"Exif\0\0" + thumbnail
    assert load(tmp_path, "whole.jpg", data[:2] + segment + data[2:]).width == 64
    assert "cut short" in refusal(tmp_path, "cut.jpg", data[:2] + segment + data[2:-20])


def test_bytes_after_the_end_do_no_harm(tmp_path: Path) -> None:
    for suffix in (".png", ".jpg"):
        assert load(tmp_path, f"a{suffix}", encoded(suffix, COLOUR) + b"trailer" * 9).width == 64


def test_a_flipped_bit_in_a_png_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    data = bytearray(encoded(".png", COLOUR))
    data[len(data) // 2] ^= 4
    assert "checksum of IDAT" in refusal(tmp_path, "a.png", bytes(data))
    assert capfd.readouterr() == ("", "")


def test_text_named_png(tmp_path: Path) -> None:
    assert "is text, not an image" in refusal(tmp_path, "a.png", b"<html>not found</html>")


def test_git_lfs_pointer(tmp_path: Path) -> None:
    assert "git lfs pull" in refusal(tmp_path, "a.png", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n")


def test_random_bytes(tmp_path: Path) -> None:
    assert "damaged or of a kind" in refusal(tmp_path, "a.jpg", np.random.default_rng(0).bytes(5000))


@pytest.mark.parametrize(
    "prefix", [b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0", b"II*\x00", b"MM\x00*", b"II+\x00", b"BM"]
)
def test_damaged_headers_end_in_one_line(tmp_path: Path, prefix: bytes, capfd: pytest.CaptureFixture) -> None:
    rng = np.random.default_rng(len(prefix))
    for n in (0, 1, 3, 10, 40, 200):
        refusal(tmp_path, "a", prefix + rng.bytes(n))
    assert capfd.readouterr() == ("", "")


def png_claiming(width: int, height: int) -> bytes:
    data = bytearray(encoded(".png", COLOUR))
    data[16:24] = struct.pack(">II", width, height)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    return bytes(data)


def test_absurd_size(tmp_path: Path) -> None:
    message = refusal(tmp_path, "bomb.png", png_claiming(100000, 100000))
    assert "100000x100000" in message
    assert f"{MAX_PIXELS // 10**6} megapixels" in message


def test_tiny_image(tmp_path: Path) -> None:
    assert "5x40 px" in refusal(tmp_path, "a.png", encoded(".png", GREY[:, :5]))


def test_raw_files_are_refused_rather_than_their_previews_read(tmp_path: Path) -> None:
    assert "raw camera file" in refusal(tmp_path, "a.nef", encoded(".tif", GREY))
    buffer = io.BytesIO()
    tags = {50706: b"\x01\x04\x00\x00"}
    PillowImage.fromarray(GREY).save(buffer, "TIFF", tiffinfo=tags)
    assert "raw camera file" in refusal(tmp_path, "a.tif", buffer.getvalue())


def test_same_grey_as_opencv_on_a_real_jpeg_kind(tmp_path: Path) -> None:
    smooth = cv2.GaussianBlur(cv2.resize(COLOUR, (640, 400)), (0, 0), 3)
    image = load(tmp_path, "a.jpg", encoded(".jpg", smooth))
    assert np.abs(image.grey.astype(int) - cv2.cvtColor(smooth, cv2.COLOR_BGR2GRAY)).mean() < 2
