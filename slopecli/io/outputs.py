"""Write the files of a report, of a plan, and of one pair of a batch; the schema of slopes.json."""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from hashlib import sha256
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slopecli import __version__
from slopecli.errors import DiskFull, InputError, expect
from slopecli.io.files import DISK_FULL, read_file, signals_held_back, sync_folder, write_through
from slopecli.io.temporary import temporary_folder
from slopecli.products import BY_DEFAULT, MAP_PRODUCTS, OUTPUT_NAMES, PRODUCTS, Product, encode_products
from slopecli.products.slopes_json import SCHEMA_VERSION, to_json
from slopecli.types import Image, Report

if TYPE_CHECKING:
    from slopecli.ground.slope_map import SlopeMap
    from slopecli.plan.result import Plan
    from slopecli.products import Answer
    from slopecli.products.origin import Origin
    from slopecli.report.camera_summary import CameraFacts

PLAN_NAMES = ("plan.png", "plan.json")  # the plan comes last: where it is, the map is
CAMERA_NAMES = ("camera.png", "camera.json")
RECORD = "pair.json"


def write_outputs(
    report: Report,
    image: Image,
    directory: str | Path,
    keep: Collection[str] = BY_DEFAULT,
    origin: Origin | None = None,
) -> list[Path]:
    """Write the files of a report to a folder: what `encode_products` gives, stored by `store_outputs`.

    `image` is image 1, `keep` the user's choices among `slopecli.products.CHOICES`, `origin` what report.html says
    besides the answer. Returns the paths of the files
    written, slopes.json first; raises as `store_outputs`, and InputError if one of them would replace an image.
    """
    expect("report", report, Report, "as estimate returns it")
    return _write(report, report, image, directory, keep, PRODUCTS, origin)


def write_map(
    slope_map: SlopeMap,
    image: Image,
    directory: str | Path,
    keep: Collection[str] = frozenset({"pictures"}),
    origin: Origin | None = None,
) -> list[Path]:
    """Write the files of a map to a folder, as `write_outputs` does those of a report.

    `image` is image 1, `keep` the user's choices among those of `slopecli.products.MAP_PRODUCTS`.
    """
    from slopecli.ground.slope_map import SlopeMap

    expect("slope_map", slope_map, SlopeMap, "as the function slope_map returns it")
    return _write(slope_map, slope_map.report, image, directory, keep, MAP_PRODUCTS, origin)


def _write(
    answer: Answer,
    report: Report,
    image: Image,
    directory: str | Path,
    keep: Collection[str],
    products: Sequence[Product],
    origin: Origin | None,
) -> list[Path]:
    check_directory(directory, inputs=[one.path for one in report.images])
    return store_outputs(encode_products(answer, image, keep, products, origin), directory)


def store_outputs(contents: dict[str, bytes], directory: str | Path, names: Sequence[str] = OUTPUT_NAMES) -> list[Path]:
    """Write the files of an answer to a folder, made if missing: all of them or none.

    Everything is stored beside before the first file appears under its name. After a failure the folder is as it was.
    If the process is killed, the last of `names` is there only if all others are: it is the first to go and the last to
    come. Files of an earlier run that are not among `contents` are removed, as they would not belong to this result.
    Returns the paths in the order given.

    Parameters
    ----------
    names : all that files of such an answer may be called, the last one last to appear.

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


def check_directory(
    directory: str | Path, names: Sequence[str] = OUTPUT_NAMES, inputs: Iterable[str | None] = ()
) -> None:
    """Raise InputError if files of these names could not be written to a folder, or would replace one of the inputs.

    Makes and changes nothing. Inputs are paths, or None and "-" for none; FILE#NAME stands for FILE.
    """
    folder = Path(directory)
    if taken := replaced_input([folder / name for name in names], inputs):
        raise InputError(_complaint(folder, f"{taken} is an input, and a file of that name is to be written"))
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


def replaced_input(outputs: Iterable[Path], inputs: Iterable[str | None]) -> str | None:
    """The first of the inputs that is the same file as one of the outputs, also through links or in other spelling."""
    written = {file for path in outputs if (file := _identity(path))}
    for given in inputs:
        ways = {given, given.rpartition("#")[0]} if given else set()
        if given and any(_identity(way) in written for way in ways if way):
            return given
    return None


def _identity(path: str | Path) -> tuple[int, int] | None:
    """Device and number of a file, None if there is none or the file system has no such numbers."""
    try:
        state = os.stat(path)
    except (OSError, ValueError):
        return None
    return (state.st_dev, state.st_ino) if state.st_ino else None


def _complaint(folder: Path, reason: str) -> str:
    return f"cannot write results to {folder}: {reason}; choose another folder with -o"


def _store(contents: dict[str, bytes], folder: Path, names: Sequence[str]) -> None:
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with temporary_folder(folder) as beside:
            for name, content in contents.items():
                write_through(beside / name, content)
            with signals_held_back():
                _exchange(folder, beside, [name for name in names if name in contents], names)
    except BaseException:
        for place in missing:
            with suppress(OSError):
                place.rmdir()
        raise


def _exchange(folder: Path, beside: Path, new: Sequence[str], names: Sequence[str]) -> None:
    """Move the old files of these names out, the last name first, and the new ones in, the last name last.

    Puts everything back if a move fails.
    """
    old = beside / "old"
    old.mkdir()
    moves = [(folder / name, old / name) for name in reversed(names) if os.path.lexists(folder / name)]
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


# ---- a plan ----


def plan_to_json(plan: Plan) -> str:
    """Serialise a plan as the text of plan.json, without a final newline; keys as in `Plan`, the same bytes always."""
    body = {field.name: getattr(plan, field.name) for field in fields(plan)}
    return to_json({"schema_version": "1.1", "slopemap_version": __version__, **body})


def write_plan(plan: Plan, directory: str | Path) -> list[Path]:
    """Write plan.json and plan.png to a folder: `store_outputs`. Returns their paths."""
    from slopecli.plan.plan_map import draw_plan
    from slopecli.products.drawing.canvas import encode_picture

    contents = {"plan.json": (plan_to_json(plan) + "\n").encode("ascii"), "plan.png": encode_picture(draw_plan(plan))}
    return store_outputs(contents, directory, PLAN_NAMES)


# ---- a camera ----


def write_camera(facts: CameraFacts, lines: list[str], image: Image | None, directory: str | Path) -> list[Path]:
    """Write camera.json, a native camera file, and camera.png to a folder: `store_outputs`. Returns their paths.

    lines : what is told of the camera, for the legend.  image : of the camera, for the background, if there is one.
    """
    from slopecli.products.camera_json import native_camera
    from slopecli.products.camera_picture import draw_camera
    from slopecli.products.drawing.canvas import encode_picture

    contents = {
        "camera.json": native_camera(facts.camera).encode("utf-8"),
        "camera.png": encode_picture(draw_camera(facts, lines, image)),
    }
    return store_outputs(contents, directory, CAMERA_NAMES)


# ---- one pair of a batch ----
# Its record is removed before the first file changes and written after the last. Where there is a record, its files are
# complete and belong together, whenever the writer was killed. Two writers of the same files do no harm.


def store_pair(folder: Path, contents: Mapping[str, bytes], record: bytes) -> None:
    """Replace the output files of a pair by `contents`, then write its record.

    Raises
    ------
    OSError : a file could not be written. Until all are on the disk, the folder is unchanged.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with temporary_folder(folder) as beside:
        for name, content in (*contents.items(), (RECORD, record)):
            write_through(beside / name, content)
        if os.path.lexists(folder / RECORD):
            (folder / RECORD).unlink(missing_ok=True)  # another writer may have removed it
            sync_folder(folder)
        for name in OUTPUT_NAMES:
            if name in contents:
                os.replace(beside / name, folder / name)
            else:
                (folder / name).unlink(missing_ok=True)
        sync_folder(folder)
        os.replace(beside / RECORD, folder / RECORD)
    sync_folder(folder)


def read_record(folder: Path) -> bytes | None:
    """The record of a pair, None if there is none or it cannot be read."""
    try:
        return read_file(RECORD, "record", 1_000_000, folder)
    except InputError:
        return None


def has_files(folder: Path, digests: Mapping[str, str]) -> bool:
    """Whether the output files of a pair are exactly these, by name and SHA-256."""
    names = [name for name in OUTPUT_NAMES if os.path.lexists(folder / name)]
    try:
        there = {name: sha256(read_file(name, "file", 10_000_000_000, folder)).hexdigest() for name in names}
    except InputError:
        return False
    return there == digests


def load_schema(version: str = SCHEMA_VERSION) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of slopes.json, of this version or an older one ("1.0", "2.1").

    Raises
    ------
    InputError : no schema of that version is shipped.
    """
    file = resources.files("slopecli").joinpath(f"schemas/slopes-{version}.schema.json")
    if not file.is_file():
        raise InputError(f"there is no schema of slopes.json of version {version!r}; this is slopemap {__version__}")
    schema: dict[str, Any] = json.loads(file.read_text("utf-8"))
    return schema
