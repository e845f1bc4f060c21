"""`slopemap camera show`: what was understood of a camera file, or of an image's metadata."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.checks import refuse
from slopecli.cli.parameter_types import PATH, SIZE
from slopecli.cli.shared_options import Flag, Option
from slopecli.cli.table import Table, print_table
from slopecli.cli.talk import Talk, check_stdout, print_facts, print_result
from slopecli.errors import InputError

if TYPE_CHECKING:
    from slopecli.io.metadata import Metadata
    from slopecli.types import Camera, Image


@click.group()
def camera() -> None:
    """Camera files, and what they mean."""


@camera.command(
    cls=shared.Command,
    params=[
        Option(shared.INPUT, "--image", "IMG", PATH, "Image of the camera: its size, its metadata, the background"),
        Option(shared.INPUT, "--size", "WxH", SIZE, "Image size, px, of a file that has none"),
        Option(shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for camera.json, native, and camera.png"),
        Flag(shared.OUTPUT, "--json as_json", "Print the numbers as JSON"),
        *shared.talk_options("Time taken"),
    ],
)
@click.argument("file", metavar="[FILE]", type=PATH, required=False)
@click.pass_context
def show(
    ctx: click.Context,
    file: str | None,
    image: str | None,
    size: tuple[int, int] | None,
    output: str | None,
    as_json: bool,
) -> None:
    """What was understood of a camera file, or of an image's metadata.

    Prints field of view, focal length, principal point, distortion at the corners and the conventions that were
    converted. Of a FILE that holds several cameras it lists them; FILE#NAME picks one. DIR gets camera.png, which draws
    all that, and camera.json, the same camera as a native file. FILE may also be an image: what its metadata state.

    \b
    Examples:
      slopemap camera show camchain.yaml#cam1 -o shown
      slopemap camera show DJI_0001.JPG
    """
    from slopecli.io.outputs import CAMERA_NAMES, check_directory, write_camera
    from slopecli.products.camera_json import camera_report
    from slopecli.report.camera_summary import camera_facts, camera_lines

    refuse(
        ctx,
        (not file and not image, "No camera: give a camera FILE, or --image IMG for what the image itself says."),
        (size and image, "--size and --image contradict each other; give one."),
    )
    talk = ctx.ensure_object(Talk)
    if file and not image and _is_image(file):
        file, image = None, file
    if output:
        check_directory(output, CAMERA_NAMES, [file, image])
    shown = _load_image(image)
    size = (shown.width, shown.height) if shown else size
    if file and not (output or as_json) and _lists_several(file, size, image, talk):
        return
    metadata = _read_metadata(image)
    found, converted = _camera(file, shown, size, metadata)
    facts = camera_facts(found)
    lines = camera_lines(facts, converted)
    with talk.timed("write"):
        written = write_camera(facts, lines, shown, output) if output else []
    if not written:
        check_stdout()
    lines += _of_metadata(found, file, metadata)
    report = camera_report(facts, converted, metadata)
    print_result(report) if as_json else print_facts(lines, len("principal point  "))
    if written:
        talk.say(f"wrote {', '.join(map(str, written))}")


def _is_image(file: str) -> bool:
    from slopecli.io.cameras.reading import split_name
    from slopecli.io.pair_sources import IMAGE_SUFFIXES

    path, frame = split_name(file)  # the name of a frame may be that of an image
    return frame is None and Path(path).suffix.lower() in IMAGE_SUFFIXES


def _load_image(path: str | None) -> Image | None:
    from slopecli.io.images import load_image

    return load_image(path) if path else None


def _read_metadata(path: str | None) -> Metadata | None:
    from slopecli.io.metadata.metadata_reading import read_metadata

    return read_metadata(path) if path else None


def _lists_several(file: str, size: tuple[int, int] | None, image: str | None, talk: Talk) -> bool:
    """Print the cameras of a file that holds several, of which none is picked; False where there is one to show."""
    from slopecli.io.cameras.reading import beside, camera_names, decode_camera, read_camera_file, split_name

    path, name = split_name(file)
    data = read_camera_file(path)
    names = camera_names(data, path)
    try:
        decode_camera(data, path, name, size, image, beside(path))
        return False
    except InputError:
        if name is not None or len(names) < 2:
            return False
    rows = []
    for one in names[:100]:
        try:
            rows.append((one, *_row(decode_camera(data, path, one, size))))
        except InputError as error:
            rows.append((one, "-", "-", "-", str(error).removeprefix(f"{path}: ")))
    print_table(Table(("camera", "image", "field of view", "focal length", "note"), rows), talk)
    talk.say(f"info: {path}: {len(names)} cameras; show one, for example {path}#{names[0]}")
    return True


def _row(found: Camera) -> tuple[str, ...]:
    from slopecli.report.camera_summary import LENSES, camera_facts

    facts = camera_facts(found)
    view = "-" if facts.horizontal_deg is None else f"{facts.horizontal_deg:.4g}°"
    return f"{found.width}x{found.height}", view, f"{facts.focal_px:.5g} px", LENSES[found.model]


def _camera(
    file: str | None, image: Image | None, size: tuple[int, int] | None, metadata: Metadata | None
) -> tuple[Camera, str]:
    """The camera, and the conventions that were converted."""
    from slopecli.io.cameras.reading import camera_for, camera_format, load_camera, read_camera_file, split_name
    from slopecli.options import CameraChoice

    if file is None:
        if metadata is None or metadata.lens is None:
            stated = metadata.path if metadata else "the image"
            raise InputError(f"{stated}: its metadata state no usable focal length; give a camera file, or --fov")
        return metadata.lens.camera(), ""
    if image is None:
        found = load_camera(file, size=size)
    else:
        found, notes = camera_for(image, CameraChoice(file=file))
        found = replace(found, note="; ".join(note.removeprefix(f"{file}: ") for note in notes))
    path, _ = split_name(file)
    return found, camera_format(read_camera_file(path), path).converted.replace("`", "")


def _of_metadata(found: Camera, file: str | None, metadata: Metadata | None) -> list[str]:
    """What the image itself states, a line each, and how its focal length compares."""
    from slopecli.io.metadata.metadata_words import metadata_lines

    if metadata is None:
        return []
    lines = metadata_lines(metadata)
    if file and metadata.lens is not None:
        ratio = found.focal_px / metadata.lens.camera().focal_px
        lines.append(f"{'compared':15s}  the focal length of the file is {ratio:.4g} times that of the metadata")
    return lines
