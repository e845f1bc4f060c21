"""Changes of image files by their structure: chunks, segments, directories and headers, and odd pixels."""

from __future__ import annotations

import struct
import zlib
from random import Random

import cv2
import numpy as np

from fuzzing.mutations import change_bytes
from fuzzing.samples import SIDE, encoded, exif_block, view

ODD_SIDES = (0, 1, 2, 3, 15, 16, SIDE - 1, SIDE + 1, 255, 4096, 20_000, 65_535, 2**24, 2**31 - 1, 2**31, 2**32 - 1)


def change_structure(rng: Random, data: bytes) -> bytes:
    """A change that the format of the file allows for; of its bytes where the format has none here."""
    ways = {
        b"\x89PNG": _change_png,
        b"\xff\xd8\xff": _change_jpeg,
        b"II*\0": _change_tiff,
        b"MM\0*": _change_tiff,
        b"RIFF": _change_riff,
        b"BM": _change_bmp,
        b"P": _change_pnm,
    }
    for start, way in ways.items():
        if data.startswith(start):
            try:
                return way(rng, data)
            except (struct.error, ValueError, IndexError):
                break  # it was damaged before
    return change_bytes(rng, data)


# ---- PNG ----


def _change_png(rng: Random, data: bytes) -> bytes:
    chunks, at = [], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    k = rng.randrange(len(chunks))
    kind, body = chunks[k]
    way = rng.randrange(8)
    if (way == 0 and kind == b"IHDR") or way == 1:
        k, (kind, body) = 0, chunks[0]
        chunks[0] = kind, _odd_header(rng, body)
    elif way == 2:
        chunks[k] = kind, change_bytes(rng, body)
    elif way == 3:
        chunks.insert(rng.randrange(len(chunks)), chunks[k])
    elif way == 4:
        del chunks[k]
    elif way == 5:
        chunks.insert(rng.randrange(1, len(chunks) + 1), _extra_chunk(rng))
    elif way == 6:
        raw = rng.randbytes(rng.choice((0, 1, 1000, SIDE * (3 * SIDE + 1))))
        chunks = [(name, zlib.compress(raw) if name == b"IDAT" else part) for name, part in chunks]
    else:
        other = rng.randrange(len(chunks))
        chunks[k], chunks[other] = chunks[other], chunks[k]
    packed = [
        struct.pack(">I", len(part)) + name + part + struct.pack(">I", zlib.crc32(name + part)) for name, part in chunks
    ]
    return data[:8] + b"".join(packed)


def _odd_header(rng: Random, body: bytes) -> bytes:
    fields = list(struct.unpack(">IIBBBBB", body))
    for _ in range(rng.choice((1, 1, 2))):
        k = rng.randrange(7)
        fields[k] = rng.choice(ODD_SIDES) if k < 2 else rng.choice((0, 1, 2, 3, 4, 6, 8, 16, 255))
    return struct.pack(">IIBBBBB", *fields)


def _extra_chunk(rng: Random) -> tuple[bytes, bytes]:
    kind = rng.choice(
        (
            b"eXIf",
            b"eXIf",
            b"iCCP",
            b"gAMA",
            b"tRNS",
            b"PLTE",
            b"acTL",
            b"fcTL",
            b"tEXt",
            b"iTXt",
            b"zTXt",
            b"sBIT",
            b"xxxx",
        )
    )
    if kind == b"eXIf":
        return kind, _change_tiff(rng, exif_block())
    if kind == b"zTXt":
        return kind, b"a\0\0" + zlib.compress(bytes(2_000_000))
    return kind, rng.randbytes(rng.choice((0, 1, 4, 26, 768)))


# ---- JPEG ----


def _change_jpeg(rng: Random, data: bytes) -> bytes:
    segments, at = [], 2
    while at + 4 <= len(data) and data[at + 1] != 0xDA:
        (length,) = struct.unpack_from(">H", data, at + 2)
        segments.append((data[at + 1], data[at + 4 : at + 2 + length]))
        at += 2 + length
    scan = data[at:]
    k = rng.randrange(len(segments))
    marker, body = segments[k]
    way = rng.randrange(9)
    if way == 0:
        k = next((k for k, (marker, _) in enumerate(segments) if 0xC0 <= marker <= 0xC2), 0)
        body = bytearray(segments[k][1])
        body[rng.randrange(1, len(body))] = rng.choice((0, 1, 2, 3, 4, 0x11, 0x22, 0x44, 0xFF))
        segments[k] = segments[k][0], bytes(body)
    elif way == 1:
        segments[k] = marker, change_bytes(rng, body)[:60_000]
    elif way == 2:
        del segments[k]
    elif way == 3:
        segments.insert(rng.randrange(len(segments)), segments[k])
    elif way == 4:
        segments.insert(0, (0xE1, b"Exif\0\0" + _change_tiff(rng, exif_block())))
    elif way == 5:
        segments.insert(
            0,
            (rng.choice((0xE1, 0xE2, 0xEE, 0xFE, 0xDD, 0xC4, 0xDB, 0xC9)), rng.randbytes(rng.choice((0, 2, 14, 300)))),
        )
    elif way == 6:
        scan = scan[: rng.randrange(len(scan))] + b"\xff\xd9" * rng.randrange(2)
    elif way == 7:
        at = rng.randrange(len(scan))
        scan = (
            scan[:at] + rng.choice((b"\xff\xd9", b"\xff\xd0", b"\xff\xda\0\x08\1\1\0\0\x3f\0", b"\0" * 50)) + scan[at:]
        )
    else:
        scan = change_bytes(rng, scan[:-2]) + b"\xff\xd9"
    packed = [bytes((0xFF, marker)) + struct.pack(">H", len(body) + 2) + body for marker, body in segments]
    return data[:2] + b"".join(packed) + scan


# ---- TIFF ----


def _change_tiff(rng: Random, data: bytes) -> bytes:
    """An entry of the first directory, or the place of the directory, changed."""
    order = "<" if data.startswith(b"II") else ">"
    found = bytearray(data)
    (start,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, start)
    entry = start + 2 + 12 * rng.randrange(count)
    odd = rng.choice((*ODD_SIDES, len(data), len(data) - 4, start, 8))
    way = rng.randrange(7)
    if way == 0:
        struct.pack_into(f"{order}I", found, 4, odd % 2**32)
    elif way == 1:
        struct.pack_into(f"{order}H", found, start, rng.choice((0, 1, count + 1, 65_535)))
    elif way == 2:
        tag = rng.choice(
            (254, 256, 257, 258, 259, 262, 273, 274, 277, 278, 279, 284, 317, 322, 323, 330, 339, 34665, 50706)
        )
        struct.pack_into(f"{order}H", found, entry, tag)
    elif way == 3:
        struct.pack_into(f"{order}H", found, entry + 2, rng.choice((0, 1, 2, 3, 4, 5, 7, 11, 12, 13, 16, 255)))
    elif way == 4:
        struct.pack_into(f"{order}I", found, entry + 4, odd % 2**32)
    elif way == 5:
        struct.pack_into(f"{order}I", found, entry + 8, odd % 2**32)
    else:
        after = start + 2 + 12 * count
        struct.pack_into(f"{order}I", found, after, rng.choice((start, 8, odd)) % 2**32)
    return bytes(found)


# ---- others ----


def _change_riff(rng: Random, data: bytes) -> bytes:
    found = bytearray(data)
    place = rng.choice((4, 16, 20, 24, 26, 28))
    number = rng.choice((*ODD_SIDES, len(data)))
    struct.pack_into("<I", found, place, number % 2**32)
    return bytes(found)


def _change_bmp(rng: Random, data: bytes) -> bytes:
    found = bytearray(data)
    place, size = rng.choice(
        ((2, "I"), (10, "I"), (14, "I"), (18, "I"), (22, "I"), (26, "H"), (28, "H"), (30, "I"), (46, "I"))
    )
    number = rng.choice((*ODD_SIDES, 4, 24, 32))
    struct.pack_into(f"<{size}", found, place, number % (2**32 if size == "I" else 2**16))
    return bytes(found)


def _change_pnm(rng: Random, data: bytes) -> bytes:
    words = data.split(maxsplit=4)
    k = rng.randrange(4)
    kinds = [b"P%d" % number for number in range(10)] + [b"Pf", b"PF"]
    sides = [b"%d" % side for side in ODD_SIDES] + [b"-1", b"9" * 30, b"1.5", b"#", b"x", b""]
    words[k] = rng.choice(kinds if k == 0 else sides)
    return b" ".join(words[:3]) + b"\n" + b" ".join(words[3:])


# ---- pixels ----


def odd_pixels(rng: Random) -> bytes:
    """A whole image file of pixels that no scene has."""
    height, width = rng.choice(
        ((SIDE, SIDE), (SIDE, SIDE), (1, 1), (8, 8), (16, 16), (17, 300), (300, 17), (64, 64), (SIDE, 2 * SIDE))
    )
    random, kind = np.random.default_rng(rng.getrandbits(32)), rng.randrange(8)
    pixels = np.zeros((height, width, 3), np.float32)
    if kind == 1:
        pixels += rng.choice((1, 127, 255, 1e-30, 1e30, np.nan, np.inf, -np.inf))
    elif kind == 2:
        pixels += random.normal(128, 40, pixels.shape)
    elif kind == 3:
        pixels[::2, ::2] = pixels[1::2, 1::2] = 255
    elif kind == 4:
        pixels[:, width // 2 :] = 255
    elif kind == 5:
        pixels += np.linspace(0, 255, width, dtype=np.float32)[:, None]
    elif kind >= 6:
        pixels = cv2.resize(view(1), (width, height)).astype(np.float32)
        with np.errstate(all="ignore"):
            pixels.ravel()[random.integers(0, pixels.size, 50)] = rng.choice((0, 255, 1e9, -1e9, np.nan, np.inf, 3e38))
    if rng.random() < 0.3:
        pixels = pixels[..., 0]
    suffix, kind = rng.choice(
        (
            (".png", np.uint8),
            (".png", np.uint16),
            (".tif", np.float32),
            (".tif", np.float64),
            (".jpg", np.uint8),
            (".webp", np.uint8),
        )
    )
    with np.errstate(all="ignore"):
        pixels = np.nan_to_num(pixels).clip(0, np.iinfo(kind).max) if np.issubdtype(kind, np.integer) else pixels
        return encoded(suffix, np.ascontiguousarray(pixels.astype(kind)))
