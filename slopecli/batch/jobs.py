"""Data of a batch: pairs, jobs for workers, answers; which pairs are finished, by the records in their folders.

A record is written after the files of its pair, and is valid for the same inputs and options.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from slopecli import __version__
from slopecli.batch.records import Outcome, read_outcome, record_of
from slopecli.errors import DiskFull
from slopecli.io.cameras.reading import split_name
from slopecli.io.files import DISK_FULL
from slopecli.io.outputs import has_files, read_record, store_pair
from slopecli.options import CameraChoice, MapOptions, MetadataChoice, Options
from slopecli.products import CHOICES, keep_files

TRANSIENT = frozenset({"crashed", "timeout", "memory", "unexpected", "unreadable", "output"})  # failures tried again

Keep = keep_files  # as programs that call `run` know it


@dataclass(frozen=True)
class Pair:
    """Two images and their cameras, as found in a folder or a list.

    name : of its folder below the output folder; unique, and valid as a file name.
    image1, image2 : paths.  camera1, camera2 : None only where there is a `problem`.
    problem : why the pair cannot be estimated; it then fails with exit status 1.
    frames : paths of all images of a sequence, the first and the last being the pair; () for a pair.
    """

    name: str
    image1: str
    image2: str
    camera1: CameraChoice | None
    camera2: CameraChoice | None
    problem: str | None = None
    frames: tuple[str, ...] = ()

    @property
    def images(self) -> tuple[str, ...]:
        """Paths of all its images."""
        return self.frames or (self.image1, self.image2)


@dataclass(frozen=True)
class Shipped:
    """Contents of the images and camera files of a pair, by path, for workers that cannot open these paths.

    fingerprint : of the pair, as in its `Outcome`.
    """

    files: dict[str, bytes]
    fingerprint: str


@dataclass(frozen=True)
class Job:
    """One pair with everything a worker needs. Can be pickled.

    keep : the user's choices of files, of `slopecli.products.CHOICES`, or of those of `MAP_PRODUCTS` for a map.
    wanted : options of a map; None for an estimate.  metadata : what is taken from the images' own; None for nothing.
    folder : where the files go, absolute.  base : folder that relative paths of the pair start from.
    shipped : None where the worker reads and writes files itself.
    """

    pair: Pair
    options: Options
    keep: frozenset[str]
    folder: str
    base: str = ""
    shipped: Shipped | None = None
    wanted: MapOptions | None = None
    metadata: MetadataChoice | None = None


@dataclass(frozen=True)
class Answer:
    """What a worker returns for a job.

    kept : the pair was finished by an earlier run.
    contents : output files of a shipped job by name, still to be stored; None if the worker has stored them.
    """

    outcome: Outcome
    kept: bool = False
    contents: dict[str, bytes] | None = None


@dataclass(frozen=True)
class Progress:
    """Counts of pairs so far: `n_kept` of the `n_done` were finished by an earlier run, `n_failed` have no answer."""

    n_pairs: int
    n_done: int
    n_failed: int
    n_kept: int
    latest: Outcome


def camera_file(choice: CameraChoice | None, base: str = "") -> tuple[str | None, str | None]:
    """Path of a camera file and the name of the camera in it; (None, None) for another choice of camera."""
    return (None, None) if choice is None or choice.file is None else split_name(choice.file, base)


def fingerprint_of(job: Job, digests: Mapping[str, str]) -> str:
    """SHA-256 of everything that determines the files of a pair.

    `digests` are the SHA-256 of the images and camera files of the job by path. The paths themselves are left out, so
    that a folder may be moved.
    """
    pair = job.pair
    document = {
        "version": __version__,
        "options": asdict(job.options),
        "keep": {choice: choice in job.keep for choice in CHOICES},
        **_map_print(job),
        **({} if job.metadata is None else {"metadata": asdict(job.metadata)}),
        "images": [digests[image] for image in pair.images],
        "cameras": [_camera_print(choice, job.base, digests) for choice in (pair.camera1, pair.camera2)],
    }
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode("ascii")).hexdigest()


def _map_print(job: Job) -> dict[str, object]:
    """What determines a map besides."""
    return {} if job.wanted is None else {"map": asdict(job.wanted), "files of the map": sorted(job.keep)}


def _camera_print(choice: CameraChoice | None, base: str, digests: Mapping[str, str]) -> object:
    file, name = camera_file(choice, base)
    if file is not None:
        return [digests[file], name]
    if choice is not None and choice.exif:
        return "exif"
    return None if choice is None else [choice.intrinsics, choice.fov_deg]


def finished(job: Job, fingerprint: str) -> Outcome | None:
    """The outcome of an earlier run, if its record has this fingerprint and its files are there; otherwise None."""
    recorded = read_outcome(read_record(Path(job.folder)) or b"")
    if recorded is None:
        return None
    outcome, digests = recorded
    if outcome.fingerprint != fingerprint or outcome.code in TRANSIENT or not has_files(Path(job.folder), digests):
        return None
    pair = job.pair
    if outcome.exit_status and (outcome.image1, outcome.image2) != (pair.image1, pair.image2):
        return None  # its message may quote the old paths
    return replace(outcome, name=pair.name, image1=pair.image1, image2=pair.image2)


def store(job: Job, outcome: Outcome, contents: Mapping[str, bytes]) -> Outcome:
    """Store the files of a pair, then its record.

    Returns
    -------
    The outcome, or a failure with the code "output" if the folder of the pair cannot be written to.

    Raises
    ------
    DiskFull : there is no space left; the folder is as it was.
    """
    try:
        store_pair(Path(job.folder), contents, record_of(outcome, contents))
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
