"""The tables of `slopemap batch`: the result of every pair, or the pairs that would be compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

from slopecli.cli.table import Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from slopecli.batch.jobs import CameraChoice, Outcome, Pair

HEADER = ("pair", "result", "steepest", "safe", "unsafe", "undecided", "poor", "refused", "note")
DRY_HEADER = ("pair", "image 1", "image 2", "camera", "note")


def batch_table(outcomes: Sequence[Outcome]) -> Table:
    """A row for each pair in their order; counts are of windows or planes, slopes in degrees."""
    return Table(HEADER, [_cells(outcome) for outcome in outcomes])


def dry_table(pairs: Sequence[Pair]) -> Table:
    """A row for each pair that would be compared."""
    return Table(DRY_HEADER, [_dry_cells(pair) for pair in pairs])


def _cells(outcome: Outcome) -> tuple[str, ...]:
    if outcome.exit_status:
        result = "no answer" if outcome.exit_status == 3 else "failed"
        return outcome.name, result, *"-" * (len(HEADER) - 3), outcome.code or ""
    counts = (
        outcome.n_safe,
        outcome.n_unsafe,
        outcome.n_undecided,
        outcome.n_planes - outcome.n_ok,
        outcome.n_rejected,
    )
    return outcome.name, "answered", _steepest(outcome), *map(str, counts), _note(outcome)


def _steepest(outcome: Outcome) -> str:
    """The steepest slope and its sigma, for each of the motions that remain."""
    texts = [f"{slope:.2f} ± {'-' if sigma is None else f'{sigma:.2f}'}°" for slope, sigma in outcome.steepest]
    return " or ".join(texts) or "-"


def _note(outcome: Outcome) -> str:
    ambiguous = ["two answers"] if outcome.ambiguity == "unresolved" else []
    return ", ".join([*ambiguous, *dict.fromkeys(outcome.diagnostics)])


def _dry_cells(pair: Pair) -> tuple[str, ...]:
    if pair.problem is not None:
        return pair.name, pair.image1 or "-", pair.image2 or "-", "-", f"cannot be tried: {pair.problem}"
    cameras = dict.fromkeys(_camera(choice) for choice in (pair.camera1, pair.camera2))
    return pair.name, pair.image1, pair.image2, ", ".join(cameras), ""


def _camera(choice: CameraChoice | None) -> str:
    if choice is None:
        return "-"
    if choice.file is not None:
        return choice.file
    return ",".join(f"{value:g}" for value in choice.intrinsics) if choice.intrinsics else f"{choice.fov_deg:g}°"
