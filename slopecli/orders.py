"""What is asked of a pair of images beyond the options of the estimate, and what it came to. Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CameraChoice:
    """What stands for the camera of one image; exactly one of the fields is set.

    file : path of a camera file, with #NAME if it holds several.
    intrinsics : fx, fy, cx, cy, px.
    fov_deg : horizontal field of view, principal point in the centre.
    """

    file: str | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    fov_deg: float | None = None


@dataclass(frozen=True)
class Outcome:
    """What one pair of a batch came to; as JSON it is one line of results.jsonl.

    Attributes
    ----------
    name : of the pair's folder.  image1, image2 : paths as given.
    exit_status : what `slopemap estimate` ends in: 0 answered, 1 input unusable, 3 no answer. 1 too with the codes
        "crashed", "timeout" and "memory", which are tried again by the next run.
    code, message, remedy : of a failure; a code as in slopes.json, or "input".
    fingerprint : SHA-256 over the bytes of images and camera files, options, files kept and version; "" where an input
        could not be read or the pair was not tried.
    files : names of the files in the pair's folder, slopes.json first.
    n_planes : windows or planes answered; n_ok of them without a doubt of their own; by verdict n_safe, n_unsafe and
        n_undecided. n_rejected : windows without an answer.
    steepest_deg, steepest_sigma_deg : slope of the steepest plane of status ok, and its 1-sigma; where two answers are
        left, in the steeper one. steepest_other_deg, steepest_other_sigma_deg : in the other.
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
        """Slope and 1-sigma of the steepest plane in every answer left, the gentler answer first, deg."""
        both = (self.steepest_other_deg, self.steepest_other_sigma_deg), (self.steepest_deg, self.steepest_sigma_deg)
        return tuple((slope, sigma) for slope, sigma in both if slope is not None)
