"""The record of a finished pair in its folder: written after its files, valid for the same inputs and options."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

from slopecli import __version__
from slopecli.batch.jobs import CameraChoice, Job, Outcome
from slopecli.errors import DiskFull
from slopecli.products import CHOICES

# Codes of failures that the next run tries again.
TRANSIENT = frozenset({"crashed", "timeout", "memory", "unexpected", "unreadable", "output"})
SIZES = "sizes"  # key of a record: size of each file, bytes


def camera_file(choice: CameraChoice | None, base: str = "") -> tuple[str | None, str | None]:
    """Path of a camera file and the name of the camera in it; (None, None) for another choice of camera."""
    from slopecli.io.cameras.reading import split_name

    return (None, None) if choice is None or choice.file is None else split_name(choice.file, base)


def fingerprint_of(job: Job, digests: Mapping[str, str]) -> str:
    """SHA-256 of everything that determines the files of a pair.

    Parameters
    ----------
    digests : SHA-256 of the images and camera files of the job, by path. The paths are not part of the fingerprint, so
        that a folder may be moved.
    """
    pair = job.pair
    document = {
        "version": __version__,
        "options": asdict(job.options),
        "keep": {choice: choice in job.keep for choice in CHOICES},
        "images": [digests[pair.image1], digests[pair.image2]],
        "cameras": [_camera_print(choice, job.base, digests) for choice in (pair.camera1, pair.camera2)],
    }
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode("ascii")).hexdigest()


def _camera_print(choice: CameraChoice | None, base: str, digests: Mapping[str, str]) -> object:
    file, name = camera_file(choice, base)
    if file is not None:
        return [digests[file], name]
    return None if choice is None else [choice.intrinsics, choice.fov_deg]


def finished(job: Job, fingerprint: str) -> Outcome | None:
    """The outcome of an earlier run, if its record has this fingerprint and its files are there; otherwise None."""
    from slopecli.io.outputs import has_files, read_record

    recorded = _recorded(read_record(Path(job.folder)))
    if recorded is None:
        return None
    outcome, sizes = recorded
    if outcome.fingerprint != fingerprint or outcome.code in TRANSIENT or not has_files(Path(job.folder), sizes):
        return None
    pair = job.pair
    if outcome.exit_status and (outcome.image1, outcome.image2) != (pair.image1, pair.image2):
        return None  # its message may quote the old paths
    return replace(outcome, name=pair.name, image1=pair.image1, image2=pair.image2)


def _record_of(outcome: Outcome, contents: Mapping[str, bytes]) -> bytes:
    """JSON of an outcome and the sizes of its files, which detect a truncated file."""
    record = {**asdict(outcome), SIZES: {name: len(content) for name, content in contents.items()}}
    return (json.dumps(record, indent=2, allow_nan=False) + "\n").encode("ascii")


def _recorded(record: bytes | None) -> tuple[Outcome, dict[str, int]] | None:
    """The outcome and the file sizes in a record, None if it is missing, damaged or of another version."""
    try:
        fields = json.loads(record or b"")
        sizes = fields.pop(SIZES)
        fields |= {key: tuple(fields[key]) for key in ("files", "diagnostics")}
        return Outcome(**fields), dict(sizes)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


def store(job: Job, outcome: Outcome, contents: Mapping[str, bytes]) -> Outcome:
    """Store the files of a pair, then its record.

    Returns
    -------
    The outcome, or a failure with the code "output" if the folder of the pair cannot be written to.

    Raises
    ------
    DiskFull : there is no space left; the folder is as it was.
    """
    from slopecli.io.files import DISK_FULL
    from slopecli.io.outputs import store_pair

    try:
        store_pair(Path(job.folder), contents, _record_of(outcome, contents))
    except OSError as error:
        if error.errno in DISK_FULL:
            raise DiskFull(f"disk full while writing to {job.folder}") from None
        message = f"cannot write results to {job.folder}: {error.strerror or error}"
        return failure(job, 1, "output", message, "make room for that folder, or choose another with -o")
    return outcome


def failure(
    job: Job, exit_status: int, code: str, message: str, remedy: str | None = None, fingerprint: str = ""
) -> Outcome:
    """The outcome of a pair without an answer."""
    pair = job.pair
    return Outcome(pair.name, pair.image1, pair.image2, exit_status, code, message, remedy, fingerprint)
