"""Decode an image file, and collect what the decoder reports of damage."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError
from slopecli.io.image_headers import ImageHeader
from slopecli.io.tiff_directories import with_one_image

READABLE = "PNG, JPEG, TIFF, BMP, WebP or PNM"
# Lines in which libjpeg, libpng and libtiff report data that cannot be right; they deliver pixels nevertheless.
DAMAGE = re.compile(r"Corrupt JPEG data: (.*)|(Premature end of JPEG file)|libpng error: (.*)|TIFF_Error (.*)")
# What else decoders and OpenCV say; OpenCV goes on in lines that are empty or begin with ">".
DECODER = re.compile(
    DAMAGE.pattern + r"|libpng warning|Invalid SOS|Unknown Adobe|unknown JFIF|\[ *(WARN|ERROR):|^>|^\s*$"
)
HEIC_BRANDS = (b"heic", b"heix", b"hevc", b"hevx", b"heim", b"heis", b"mif1", b"msf1")
OTHER_KINDS = (
    (b"%PDF", "a PDF"),
    (b"%!PS", "a PostScript"),
    (b"8BPS", "a Photoshop"),
    (b"v/1\x01", "an OpenEXR"),
    (b"\xff\x0a", "a JPEG XL"),
    (b"\0\0\0\x0cJXL ", "a JPEG XL"),
    (b"qoif", "a QOI"),
    (b"DDS ", "a DDS"),
    (b"\0\0\x01\0", "an icon"),
    (b"SIMPLE  =", "a FITS"),
    (b"\x93NUMPY", "a NumPy"),
    (b"\x89HDF", "an HDF5"),
    (b"PK\x03\x04", "a ZIP"),
    (b"\x1f\x8b", "a gzip"),
    (b"\x1aE\xdf\xa3", "a video"),
)
_one_at_a_time = Lock()  # stderr is one for the whole process


def decode_pixels(data: bytes, header: ImageHeader) -> NDArray[Any]:
    """Pixels as stored, with their own depth and channels.

    Raises
    ------
    InputError : no decoder reads the file, or one reports that it is damaged. The message does not name the file.
    """
    import cv2

    if header.image is not None:
        data = with_one_image(data, header.image)  # OpenCV reads the first image and turns it whatever the flags
    level = cv2.utils.logging.getLogLevel()
    with _one_at_a_time, _what_stderr_gets() as said:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_WARNING)
        try:
            pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            if error.code == cv2.Error.STS_NO_MEM:
                raise MemoryError from None
            pixels = None
        finally:
            cv2.utils.logging.setLogLevel(level)
    damage = next((next(filter(None, found.groups())) for found in map(DAMAGE.search, said) if found), None)
    if pixels is None:
        raise InputError(header.unusual or _why_not_decoded(data, damage))
    if damage is not None:
        raise InputError(
            f"is damaged ({damage.strip()[:80]}); copy or download it again, or save it anew if it looks right"
        )
    return pixels


@contextmanager
def _what_stderr_gets() -> Iterator[list[str]]:
    """Collect the lines that decoders write to stderr meanwhile; lines of others are passed on afterwards."""
    lines: list[str] = []
    with ExitStack() as stack:
        try:
            file = stack.enter_context(tempfile.TemporaryFile())
            kept = os.dup(2)
        except OSError:  # no room for such a file, or no stderr: then nothing is heard
            yield lines
            return
        with suppress(OSError, ValueError, AttributeError):
            sys.stderr.flush()
        try:
            os.dup2(file.fileno(), 2)
            yield lines
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            lines += file.read(1 << 20).decode("utf-8", "replace").splitlines()
    others = [line for line in lines if not DECODER.search(line)]
    if others:
        with suppress(OSError):
            os.write(2, "".join(f"{line}\n" for line in others).encode())


def _why_not_decoded(data: bytes, damage: str | None) -> str:
    if data.startswith(b"version https://git-lfs"):
        return "is a Git LFS pointer, not the image itself; run `git lfs pull`"
    kind = next((kind for start, kind in OTHER_KINDS if data.startswith(start)), None)
    if data[4:8] == b"ftyp":
        avif = "an AVIF" if data[8:12] in (b"avif", b"avis") else "a video"
        kind = "a HEIC" if data[8:12] in HEIC_BRANDS else avif
    if kind is not None:
        return f"is {kind} file, needed {READABLE}; convert it first"
    if not any(byte < 9 for byte in data[:512]) and not re.match(rb"P[1-7]\s", data):
        return f"is text, not an image; needed {READABLE}"
    reason = f" ({damage.strip()[:80]})" if damage else ""
    return f"is damaged or of a kind that cannot be read{reason}; needed {READABLE}, try to open and save it again"
