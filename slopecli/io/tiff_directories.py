"""The directories of a TIFF file or EXIF block: their integer and text tags, and which one is the full image.

Source: TIFF 6.0; BigTIFF; TIFF Technical Note 1 (directories below others).
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import NamedTuple

TIFF_SIGNATURES = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
INTEGER_TYPES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q", 18: "Q"}


class TiffTag(IntEnum):
    """Numbers of the tags that are looked at, and of a value."""

    SUBFILE_TYPE = 254
    OLD_SUBFILE_TYPE = 255
    WIDTH = 256
    HEIGHT = 257
    BITS = 258
    COMPRESSION = 259
    PHOTOMETRIC = 262
    COLOUR_FILTERS = 32803  # value of PHOTOMETRIC of raw pixels
    ORIENTATION = 274
    SAMPLES = 277
    PLANAR = 284
    SUB_DIRECTORIES = 330
    SAMPLE_FORMAT = 339
    NODATA = 42113
    DNG_VERSION = 50706


class Layout(NamedTuple):
    """Byte order ("<" or ">"), and the codes and sizes of numbers: 32-bit offsets in TIFF, 64-bit in BigTIFF."""

    order: str
    is_big: bool

    @property
    def offset(self) -> str:
        """Code of an offset and of a count of values."""
        return "Q" if self.is_big else "I"


class Directory(NamedTuple):
    """start : offset of the directory in the file; tags : values of its integer tags, (text,) for text tags.

    entries : offsets of the entries by tag.
    """

    start: int
    tags: dict[int, tuple[int | str, ...]]
    entries: dict[int, int]

    def number(self, tag: int, missing: int = 0) -> int:
        """The first value of an integer tag."""
        value = self.tags.get(tag, (missing,))[:1]
        return value[0] if value and isinstance(value[0], int) else missing

    def text(self, tag: int) -> str:
        """The value of a text tag, "" if there is none."""
        value = self.tags.get(tag, ("",))[0]
        return value if isinstance(value, str) else ""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.number(TiffTag.WIDTH), self.number(TiffTag.HEIGHT)

    @property
    def is_reduced(self) -> bool:
        """Whether it says that it is a smaller version of another image, or a mask."""
        return bool(self.number(TiffTag.SUBFILE_TYPE) & 0b101) or self.number(TiffTag.OLD_SUBFILE_TYPE) == 2


def read_directories(data: bytes) -> list[Directory]:
    """All directories that can be read, in the order of the file, each followed by those below it; [] if none can.

    What lies outside of the file is left out, so damaged bytes raise nothing.
    """
    if not data.startswith(TIFF_SIGNATURES):
        return []
    layout = Layout("<" if data.startswith(b"II") else ">", b"+" in data[2:4])
    found: dict[int, Directory] = {}
    waiting = [_number(data, layout, 8 if layout.is_big else 4)]
    while waiting and len(found) < 1000:  # a file that points to itself again and again has no end
        start = waiting.pop()
        directory, following = _directory(data, layout, start) if start and start not in found else (None, 0)
        if directory is not None:
            found[start] = directory
            below = [offset for offset in directory.tags.get(TiffTag.SUB_DIRECTORIES, ()) if isinstance(offset, int)]
            waiting += [following, *reversed(below)]
    return [directory for directory in found.values() if directory.tags]


def full_image(directories: list[Directory]) -> Directory | None:
    """The first of the largest images that are not marked as reduced; None if no directory holds an image."""
    images = [directory for directory in directories if min(directory.size) > 0]
    full = [directory for directory in images if not directory.is_reduced] or images
    return max(full, key=lambda directory: directory.size[0] * directory.size[1], default=None)


def with_one_image(data: bytes, directory: Directory) -> bytes:
    """The file with this directory in the first place and orientation 1, so that decoders read it as it is stored."""
    layout = Layout("<" if data.startswith(b"II") else ">", b"+" in data[2:4])
    changed = bytearray(data)
    struct.pack_into(layout.order + layout.offset, changed, 8 if layout.is_big else 4, directory.start)
    if TiffTag.ORIENTATION in directory.entries:
        entry = struct.Struct(f"{layout.order}HH{layout.offset}H")  # the type SHORT, one value
        entry.pack_into(changed, directory.entries[TiffTag.ORIENTATION], TiffTag.ORIENTATION, 3, 1, 1)
    return bytes(changed)


def _directory(data: bytes, layout: Layout, start: int) -> tuple[Directory | None, int]:
    """The directory at an offset, None if it lies outside of the file, and the offset of the next one."""
    head, size = ("Q", 20) if layout.is_big else ("H", 12)
    first = start + struct.calcsize(head)
    if first > len(data):
        return None, 0
    (count,) = struct.unpack_from(layout.order + head, data, start)
    count = min(count, (len(data) - first) // size)
    entries: dict[int, int] = {}
    for place in range(first, first + count * size, size):
        (tag,) = struct.unpack_from(layout.order + "H", data, place)
        entries.setdefault(tag, place)
    tags = {tag: _values(data, layout, place) for tag, place in entries.items()}
    directory = Directory(start, {tag: values for tag, values in tags.items() if values}, entries)
    return directory, _number(data, layout, first + count * size)


def _values(data: bytes, layout: Layout, entry: int) -> tuple[int | str, ...]:
    """The values of an entry; () for other types than integers and text, and if they lie outside of the file."""
    kind, count = struct.unpack_from(f"{layout.order}H{layout.offset}", data, entry + 2)
    code = INTEGER_TYPES.get(kind, "s" if kind == 2 else "")
    if not code or not 0 < count <= 256:  # texts, offsets and counts that are looked at are shorter
        return ()
    values = struct.Struct(f"{layout.order}{count}{code}")
    place = entry + (12 if layout.is_big else 8)
    if values.size > struct.calcsize(layout.offset):
        place = _number(data, layout, place)
    if place + values.size > len(data):
        return ()
    found = values.unpack_from(data, place)
    return (found[0].split(b"\0")[0].decode("latin-1").strip(),) if code == "s" else found


def _number(data: bytes, layout: Layout, place: int) -> int:
    """An offset that is stored at a place; 0 if that lies outside of the file."""
    number = struct.Struct(layout.order + layout.offset)
    return int(number.unpack_from(data, place)[0]) if place + number.size <= len(data) else 0
