"""The outcome of a pair, and the record of it in the pair's folder, which is believed only where all of it fits.

A record is JSON: the attributes of the `Outcome`, the SHA-256 of the files of the pair by name, and that of the record
itself, so that a change of any of them is noticed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from slopecli.products import OUTPUT_NAMES

FILES_KEY, OWN_KEY = "sha256", "record_sha256"


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
    safe_share, unsafe_share, undecided_share, unknown_share : of the cells of a map, by verdict; None without a map.
    n_sites : landing sites of a map.  site_radius_px, site_radius, site_slope_deg, site_slope_sigma_deg : of the
        largest, its radius in px of image 1 and in the unit of the scale.
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
    safe_share: float | None = None
    unsafe_share: float | None = None
    undecided_share: float | None = None
    unknown_share: float | None = None
    n_sites: int = 0
    site_radius_px: float | None = None
    site_radius: float | None = None
    site_slope_deg: float | None = None
    site_slope_sigma_deg: float | None = None
    ambiguity: str | None = None
    noise_px: float | None = None
    diagnostics: tuple[str, ...] = ()

    @property
    def is_map(self) -> bool:
        """Whether this is the answer of `slopemap map`."""
        return self.safe_share is not None

    @property
    def shares(self) -> tuple[float | None, float | None, float | None, float | None]:
        """Shares of the cells of a map that are safe, unsafe, undecided and unknown."""
        return self.safe_share, self.unsafe_share, self.undecided_share, self.unknown_share

    @property
    def steepest(self) -> tuple[tuple[float, float | None], ...]:
        """Slope and 1-sigma of the steepest plane in each root, deg, the gentler root first."""
        both = (self.steepest_other_deg, self.steepest_other_sigma_deg), (self.steepest_deg, self.steepest_sigma_deg)
        return tuple((slope, sigma) for slope, sigma in both if slope is not None)


def record_of(outcome: Outcome, contents: Mapping[str, bytes]) -> bytes:
    """The record of an outcome with these files, ASCII."""
    fields = {**asdict(outcome), FILES_KEY: {name: sha256(content).hexdigest() for name, content in contents.items()}}
    return (_json({**fields, OWN_KEY: _digest(fields)}) + "\n").encode("ascii")


def read_outcome(record: bytes) -> tuple[Outcome, dict[str, str]] | None:
    """The outcome and the SHA-256 of the files by name; None if the record is damaged or changed."""
    try:
        fields = json.loads(record)
        if fields.pop(OWN_KEY) != _digest(fields):
            return None
        digests = fields.pop(FILES_KEY)
        fields |= {key: tuple(fields[key]) for key in ("files", "diagnostics")}
        outcome = Outcome(**fields)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    kinds = get_type_hints(Outcome)
    fits = all(_is(value, kinds[name]) for name, value in vars(outcome).items()) and _is(digests, dict[str, str])
    return (outcome, digests) if fits and _is_consistent(outcome, digests) else None


def _digest(fields: Mapping[str, Any]) -> str:
    return sha256(_json(fields).encode("ascii")).hexdigest()


def _json(fields: Mapping[str, Any]) -> str:
    return json.dumps(fields, indent=2, allow_nan=False)


def _is(value: object, kind: Any) -> bool:
    """Whether a value has a type as JSON keeps it: a whole number is a float too, but a truth value is no number."""
    if isinstance(kind, UnionType):
        return any(_is(value, part) for part in get_args(kind))
    if get_origin(kind) is tuple:
        return isinstance(value, tuple) and all(isinstance(part, str) for part in value)
    if get_origin(kind) is dict:
        return isinstance(value, dict) and all(isinstance(part, str) for pair in value.items() for part in pair)
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return isinstance(value, kind) and not (kind is int and isinstance(value, bool))


def _is_consistent(outcome: Outcome, digests: Mapping[str, str]) -> bool:
    """Whether the attributes can be of one answer or of one failure."""
    n_planes = outcome.n_ok, outcome.n_safe, outcome.n_unsafe, outcome.n_undecided, outcome.n_rejected, outcome.n_planes
    counts = (*n_planes, outcome.n_sites)
    verdicts = outcome.n_safe + outcome.n_unsafe + outcome.n_undecided
    return (
        outcome.files == tuple(digests)
        and set(outcome.files) <= set(OUTPUT_NAMES)
        and outcome.exit_status in (0, 1, 3)
        and (outcome.exit_status == 0) == (outcome.code is None)
        and min(counts) >= 0
        and max(outcome.n_ok, verdicts) <= outcome.n_planes
    )
