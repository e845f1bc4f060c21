"""Read the metadata of an image file."""

from __future__ import annotations

from os import PathLike

from slopecli.io.images import read_image_file
from slopecli.io.metadata.apple_gravity import gravity_attitude
from slopecli.io.metadata.attitudes import as_stored, attitude_of, heading_of
from slopecli.io.metadata.image_metadata import Metadata
from slopecli.io.metadata.image_tags import ImageTags, Tag, number_of, read_tags
from slopecli.io.metadata.lenses import lens_of, taken_size
from slopecli.io.metadata.positions import position_of, relative_altitude_of


def read_metadata(path: str | PathLike[str]) -> Metadata:
    """What an image file states of its camera, place and attitude; its pixels are not decoded.

    A file without metadata, or with damaged ones, gives a `Metadata` whose fields are None and whose `notes` say why.

    Raises
    ------
    InputError : the file cannot be read.
    """
    return decode_metadata(read_image_file(path), path)


def decode_metadata(data: bytes, path: str | PathLike[str]) -> Metadata:
    """As `read_metadata`, from the bytes of the file; `path` is for messages and is not opened."""
    tags = read_tags(data)
    orientation = _orientation(tags)
    heading, of_heading = heading_of(tags)
    attitude, of_attitude = attitude_of(tags)
    of_turn = ""
    if attitude is not None:
        attitude, of_turn = as_stored(attitude, orientation)
    elif not of_attitude:
        attitude, of_attitude = gravity_attitude(tags, orientation, heading)
    position, of_position = position_of(tags)
    lens, of_lens = lens_of(tags)
    return Metadata(
        path=str(path),
        size=tags.size,
        taken_size=taken_size(tags),
        orientation=orientation,
        maker=tags.text(Tag.MAKER),
        model=tags.text(Tag.MODEL),
        lens=lens,
        position=position,
        relative_altitude_m=relative_altitude_of(tags),
        attitude=attitude,
        heading_deg=heading,
        notes=(*tags.notes, *(note for note in (of_lens, of_position, of_attitude, of_turn, of_heading) if note)),
    )


def _orientation(tags: ImageTags) -> int:
    value = number_of(tags.main.get(Tag.ORIENTATION))
    return int(value) if value is not None and value in range(1, 9) else 1
