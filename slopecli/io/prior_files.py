"""A CSV file of what is known of the frames of a sequence: positions, altitudes, angles, each with its 1-sigma."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

from slopecli.errors import InputError
from slopecli.geometry.attitude import ned_from_camera
from slopecli.io.files import csv_rows, read_file
from slopecli.io.frame_sources import FrameSource
from slopecli.sequence.frame import Frame, FramePrior

POSITION, ANGLES = ("x_m", "y_m", "z_m"), ("pitch_deg", "roll_deg")
SIGMAS = {
    "position_sigma_m": "x_m",
    "altitude_sigma_m": "altitude_m",
    "attitude_sigma_deg": "pitch_deg",
}  # and the first column of what each is of
POSITIVE = ("position_sigma_m", "altitude_m", "altitude_sigma_m", "attitude_sigma_deg")
KNOWN = ("frame", *POSITION, *ANGLES, "yaw_deg", *POSITIVE)
PASSED_OVER = ("image", "time_s")  # columns for the reader of the file
NEEDED = f"needed a heading with some of {', '.join(KNOWN)}, and numbers below it, empty where not known"


def read_priors(path: str) -> dict[int | None, FramePrior]:
    """What is known of frames, by their number from 1; the key None is there where the rows are those of all frames.

    Raises
    ------
    InputError : the file is no such table, with the line and what was needed.
    """
    rows = csv_rows(path, read_file(path, "file of priors", 100_000_000), NEEDED)
    names = next((cells for _, cells in rows), None)
    if names is None:
        raise InputError(f"{path}: is empty; {NEEDED}")
    unknown = [name for name in names if name not in (*KNOWN, *PASSED_OVER)]
    if unknown or len(set(names)) < len(names):
        what = f"has a column {unknown[0]!r:.40}" if unknown else "names a column twice"
        raise InputError(f"{path}: {what}; {NEEDED}")
    found: dict[int | None, FramePrior] = {}
    for count, (line, cells) in enumerate(rows, 1):
        if len(cells) != len(names):
            raise InputError(f"{path}: line {line} has {len(cells)} cells for {len(names)} columns; {NEEDED}")
        values = {name: _number(path, line, name, cell) for name, cell in zip(names, cells, strict=True) if cell}
        number = count if "frame" not in names else _frame(path, line, values.get("frame"))
        if number in found:
            raise InputError(f"{path}: line {line} is of frame {number} again; needed one row a frame")
        found[number] = _prior(path, line, values)
    if not found:
        raise InputError(f"{path}: has no rows below its heading; {NEEDED}")
    return found if "frame" in names else {None: FramePrior(), **found}


def _number(path: str, line: int, name: str, cell: str) -> float:
    if name in PASSED_OVER:
        return 0.0
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or abs(value) > 1e9:
        raise InputError(f"{path}: line {line} has {cell[:40]!r} as {name}; needed a number, or an empty cell")
    if name in POSITIVE and value < 1e-9:
        raise InputError(f"{path}: line {line} has {cell[:40]} as {name}; needed a number above 0, or an empty cell")
    return value


def _frame(path: str, line: int, value: float | None) -> int:
    if value is None or value < 1 or value != int(value):
        raise InputError(f"{path}: line {line} is of no frame; needed their numbers from 1 in the column frame")
    return int(value)


def _prior(path: str, line: int, values: dict[str, float]) -> FramePrior:
    """What a row tells, its groups complete."""
    position = tuple(values[name] for name in POSITION if name in values)
    angles = [name for name in (*ANGLES, "yaw_deg") if name in values]
    for some, group in ((position, POSITION), (angles, ANGLES)):
        if some and not all(name in values for name in group):
            raise InputError(f"{path}: line {line} has some of {', '.join(group)}; needed all of them, or none")
    for sigma, value in SIGMAS.items():
        if sigma in values and value not in values:
            raise InputError(f"{path}: line {line} has {sigma} without {value}; needed both, or neither")
    ned = None
    if angles:
        ned = ned_from_camera(values.get("yaw_deg", 0.0), values["pitch_deg"], values["roll_deg"])
    return FramePrior(
        position_m=(position[0], position[1], position[2]) if position else None,
        position_sigma_m=values.get("position_sigma_m"),
        altitude_m=values.get("altitude_m"),
        altitude_sigma_m=values.get("altitude_sigma_m"),
        ned=ned,
        heading="yaw_deg" in values,
        attitude_sigma_deg=values.get("attitude_sigma_deg"),
    )


def with_frame_priors(
    source: FrameSource, path: str, priors: dict[int | None, FramePrior], say: Callable[[str], None]
) -> FrameSource:
    """The frames, each with what is known of it.

    say : told, in a line, at the last frame of a video or camera that there were not as many as the rows are of.

    Raises
    ------
    InputError : there are not as many rows as frames, and the rows do not say of which they are; or they are of more.
    """
    whole = None in priors
    last = max((number for number in priors if number is not None), default=0)

    def wrong(total: int) -> str:
        """What is wrong with the rows for so many frames; "" if nothing is."""
        if whole and last != total:
            return f"{path}: has {last} rows for {total} frames; give one a frame, or their numbers in a column frame"
        if last > total:
            return f"{path}: has a row of frame {last}, but there are {total}; frames count from 1, in their order"
        return ""

    if source.total is not None and (message := wrong(source.total)):
        raise InputError(message)

    def numbered() -> Iterator[Frame]:
        """The frames after the first."""
        number = 1
        for number, frame in enumerate(source.rest, 2):
            yield frame._replace(prior=priors.get(number))
        if source.total is None and (message := wrong(number)):
            say(f"warning: {message}")

    return replace(source, first=source.first._replace(prior=priors.get(1)), rest=numbered())
