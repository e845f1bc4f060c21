"""The nouns of a batch: pairs, jobs for workers, their answers. Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass

from slopecli.options import Options
from slopecli.orders import CameraChoice, Outcome
from slopecli.products import keep_files

__all__ = ["Answer", "CameraChoice", "Job", "Keep", "Outcome", "Pair", "Progress", "Shipped"]

Keep = keep_files  # as programs that call `run` know it


@dataclass(frozen=True)
class Pair:
    """Two images to compare, as pairing finds them.

    name : folder below the output folder; unique, and safe as a file name.
    image1, image2 : paths.  camera1, camera2 : None only where there is a `problem`.
    problem : why the pair cannot even be tried; it is then recorded as failed with exit status 1.
    """

    name: str
    image1: str
    image2: str
    camera1: CameraChoice | None
    camera2: CameraChoice | None
    problem: str | None = None


@dataclass(frozen=True)
class Shipped:
    """Contents of the images and camera files of a pair, by path, for workers that do not see these paths.

    fingerprint : of the pair, as in its `Outcome`.
    """

    files: dict[str, bytes]
    fingerprint: str


@dataclass(frozen=True)
class Job:
    """One pair with everything a worker needs; can be pickled.

    keep : the user's choices of files, of `slopecli.products.CHOICES`.
    folder : where the files go, absolute.  base : folder that relative paths of the pair start from.
    shipped : None where the worker reads and writes files itself.
    """

    pair: Pair
    options: Options
    keep: frozenset[str]
    folder: str
    base: str = ""
    shipped: Shipped | None = None


@dataclass(frozen=True)
class Answer:
    """What a worker gives back for a job.

    kept : the pair was finished before, by an earlier run.
    contents : files of a shipped job by name, still to be stored; None where the worker stored them.
    """

    outcome: Outcome
    kept: bool = False
    contents: dict[str, bytes] | None = None


@dataclass(frozen=True)
class Progress:
    """How far a batch is; `n_kept` of the `n_done` pairs were finished by an earlier run, `n_failed` have no answer."""

    n_pairs: int
    n_done: int
    n_failed: int
    n_kept: int
    latest: Outcome
