"""Writing a report's files: all of them or none."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from slopecli.errors import DiskFull, InputError
from slopecli.io.atomic import DISK_FULL, TEMPORARY, write_through
from slopecli.types import Image, Report

RESULT, OVERLAY, PLY, GLB, LABELS = "slopes.json", "overlay.png", "patches.ply", "patches.glb", "labels.png"
# of the pictures that `draw_steps` gives
STEPS = {"gradient": "step1_gradient.png", "components": "step2_components.png", "merged": "step3_merged.png"}
# the result comes last: where it is, the others are
OUTPUT_NAMES = (*STEPS.values(), OVERLAY, PLY, GLB, LABELS, RESULT)


def write_outputs(
    report: Report,
    image: Image,
    directory: str | Path,
    *,
    overlay: bool = True,
    ply: bool = True,
    glb: bool = True,
    debug_images: bool = False,
) -> list[Path]:
    """Write slopes.json, labels.png and, unless declined, overlay.png, patches.ply and patches.glb.

    What `encode_outputs` gives, stored by `store_outputs`.

    Parameters
    ----------
    report : the finished answer.
    image : image 1, drawn under the overlay.
    directory : folder to write to; made if missing.

    Returns
    -------
    Paths of the files written, slopes.json first.

    Raises
    ------
    InputError : the folder cannot be made or written to.
    DiskFull : there is no space left.
    """
    contents = encode_outputs(report, image, overlay=overlay, ply=ply, glb=glb, debug_images=debug_images)
    return store_outputs(contents, directory)


def encode_outputs(
    report: Report,
    image: Image,
    *,
    overlay: bool = True,
    ply: bool = True,
    glb: bool = True,
    debug_images: bool = False,
) -> dict[str, bytes]:
    """The files of a report by name, slopes.json first; nothing is written.

    patches.glb is made where planes were found as regions; the pictures of the segmentation's steps, where there was
    one and if they are asked for.
    """
    from slopecli.look.threads import single_threaded
    from slopecli.products.png import encode_labels
    from slopecli.products.slopes_json import report_to_json

    with single_threaded():
        contents = {RESULT: (report_to_json(report) + "\n").encode("ascii"), LABELS: encode_labels(report)}
        contents |= _encode_pictures(report, image, overlay, debug_images) | _encode_meshes(report, image, ply, glb)
    return {name: contents[name] for name in reversed(OUTPUT_NAMES) if name in contents}


def store_outputs(contents: dict[str, bytes], directory: str | Path, names: Sequence[str] = OUTPUT_NAMES) -> list[Path]:
    """Write the files of an answer to a folder, made if missing: all of them or none.

    Everything is stored beside before the first file appears under its name. After a failure the folder is as it was.
    Files of an earlier run that are not among `contents` are removed, as they would not belong to this result.

    Parameters
    ----------
    names : all that files of such an answer may be called, the last one last to appear.

    Returns
    -------
    Their paths, in the order given.

    Raises
    ------
    InputError : the folder cannot be made or written to.
    DiskFull : there is no space left.
    """
    folder = Path(directory)
    check_directory(folder, names)
    try:
        _store(contents, folder, names)
    except OSError as error:
        kind = DiskFull if error.errno in DISK_FULL else InputError
        raise kind(_complaint(folder, error.strerror or str(error))) from error
    return [folder / name for name in contents]


def check_directory(directory: str | Path, names: Sequence[str] = OUTPUT_NAMES) -> None:
    """Raise InputError if files of these names could not be written to a folder. Makes and changes nothing.

    Worth calling before a long computation.
    """
    folder = Path(directory)
    blocked = [name for name in names if os.path.isdir(folder / name)]
    if blocked:
        raise InputError(
            _complaint(folder, f"{blocked[0]} in it is a folder, and a file of that name is to be written")
        )
    nearest = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    if not os.path.isdir(nearest):
        raise InputError(_complaint(folder, f"{nearest} is not a folder"))
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(_complaint(folder, f"no permission to write in {nearest}"))


def _complaint(folder: Path, reason: str) -> str:
    return f"cannot write results to {folder}: {reason}; choose another folder with -o"


def _encode_pictures(report: Report, image: Image, overlay: bool, steps: bool) -> dict[str, bytes]:
    from slopecli.products.overlay import draw_overlay
    from slopecli.products.png import encode_picture

    pictures = {OVERLAY: draw_overlay(report, image)} if overlay else {}
    if steps:
        from slopecli.products.steps import draw_steps

        pictures |= {STEPS[step]: picture for step, picture in draw_steps(report, image).items()}
    return {name: encode_picture(picture) for name, picture in pictures.items()}


def _encode_meshes(report: Report, image: Image, ply: bool, glb: bool) -> dict[str, bytes]:
    from slopecli.products.ply import report_to_ply

    if not report.found:
        return {PLY: report_to_ply(report, image)} if ply else {}
    from slopecli.products.glb import report_to_glb
    from slopecli.products.region_mesh import region_surfaces

    surfaces = region_surfaces(report) if ply or glb else []
    contents = {PLY: report_to_ply(report, image, surfaces)} if ply else {}
    if glb:
        contents[GLB] = report_to_glb(report, image, surfaces)
    return contents


def _store(contents: dict[str, bytes], folder: Path, names: Sequence[str]) -> None:
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # inside the folder, so that the files need not cross file systems to get their names
        with tempfile.TemporaryDirectory(prefix=TEMPORARY, dir=folder) as beside:
            for name, content in contents.items():
                write_through(Path(beside, name), content)
            _exchange(folder, Path(beside), [name for name in names if name in contents], names)
    except BaseException:
        for place in missing:
            with suppress(OSError):
                place.rmdir()
        raise


def _exchange(folder: Path, beside: Path, new: Sequence[str], names: Sequence[str]) -> None:
    """Move the old files of these names out and the new ones in; puts everything back if a move fails."""
    old = beside / "old"
    old.mkdir()
    moves = [(folder / name, old / name) for name in names if os.path.lexists(folder / name)]
    moves += [(beside / name, folder / name) for name in new]
    done: list[tuple[Path, Path]] = []
    try:
        for source, target in moves:
            os.rename(source, target)
            done.append((source, target))
    except BaseException:
        for source, target in reversed(done):
            os.replace(target, source)
        raise
