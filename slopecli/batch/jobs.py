"""Data of a batch: pairs, jobs for workers, answers, outcomes. Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass

from slopecli.options import CameraChoice, Options
from slopecli.products import keep_files

__all__ = ["Answer", "CameraChoice", "Job", "Keep", "Outcome", "Pair", "Progress", "Shipped"]

Keep = keep_files  # as programs that call `run` know it


@dataclass(frozen=True)
class Pair:
    """Two images and their cameras, as found in a folder or a list.

    name : of its folder below the output folder; unique, and valid as a file name.
    image1, image2 : paths.  camera1, camera2 : None only where there is a `problem`.
    problem : why the pair cannot be estimated; it then fails with exit status 1.
    """

    name: str
    image1: str
    image2: str
    camera1: CameraChoice | None
    camera2: CameraChoice | None
    problem: str | None = None


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
    """What a worker returns for a job.

    kept : the pair was finished by an earlier run.
    contents : output files of a shipped job by name, still to be stored; None if the worker has stored them.
    """

    outcome: Outcome
    kept: bool = False
    contents: dict[str, bytes] | None = None


@dataclass(frozen=True)
class Outcome:
    """The result of one pair of a batch; as JSON it is one line of results.jsonl.

    Attributes
    ----------
    name : of the pair's folder.  image1, image2 : paths as given.
    exit_status : that of `slopemap estimate`: 0 answered, 1 input unusable, 3 no answer; 1 also for failures that the
        next run tries again, such as "crashed", "timeout" and "memory".
    code, message, remedy : of a failure; a code as in slopes.json, or "input".
    fingerprint : SHA-256 over the bytes of images and camera files, options, files kept and version; "" if an input
        could not be read.
    files : names of the files in the pair's folder, slopes.json first.
    n_planes : windows or planes answered.  n_ok : those of status "ok".  n_safe, n_unsafe, n_undecided : by verdict.
    n_rejected : windows without an answer.
    steepest_deg, steepest_sigma_deg : slope of the steepest plane of status ok, and its 1-sigma; of the root in which
        it is steeper, where there are two.  steepest_other_deg, steepest_other_sigma_deg : of the other root.
    ambiguity : status as in slopes.json.  noise_px : of the fit.  diagnostics : their codes.
    """

    name: str
    image1: str
    image2: str
    exit_status: int
    code: str | None = None
    message: str | None = None
    remedy: str | None = None
    fingerprint: str = ""
    files: tuple[str, ...] = ()
    n_planes: int = 0
    n_ok: int = 0
    n_safe: int = 0
    n_unsafe: int = 0
    n_undecided: int = 0
    n_rejected: int = 0
    steepest_deg: float | None = None
    steepest_sigma_deg: float | None = None
    steepest_other_deg: float | None = None
    steepest_other_sigma_deg: float | None = None
    ambiguity: str | None = None
    noise_px: float | None = None
    diagnostics: tuple[str, ...] = ()

    @property
    def steepest(self) -> tuple[tuple[float, float | None], ...]:
        """Slope and 1-sigma of the steepest plane in each root, deg, the gentler root first."""
        both = (self.steepest_other_deg, self.steepest_other_sigma_deg), (self.steepest_deg, self.steepest_sigma_deg)
        return tuple((slope, sigma) for slope, sigma in both if slope is not None)


@dataclass(frozen=True)
class Progress:
    """Counts of pairs so far: `n_kept` of the `n_done` were finished by an earlier run, `n_failed` have no answer."""

    n_pairs: int
    n_done: int
    n_failed: int
    n_kept: int
    latest: Outcome
