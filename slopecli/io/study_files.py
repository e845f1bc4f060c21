"""Writing the files of a simulation study: tables of trials and scenes, a summary with verdicts, figures."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from slopecli import __version__
from slopecli.io.outputs import store_outputs
from slopecli.products.slopes_json import SIGNIFICANT_DIGITS, to_json
from slopecli.study.claims import CannotTell, Claim, bound_ratios, mean, rms
from slopecli.study.figures import TIMES, draw_figures, draw_times
from slopecli.study.trials import QUANTITIES, Spread, Study, Timing
from slopecli.types import FloatArray

TRIALS, SCENES, SUMMARY = "trials.csv", "scenes.csv", "summary.json"
TIMING_TABLE, TIMING = "timing.csv", "timing.json"
FIGURE_NAMES = ("figure2_alignment", "figure4_motion", "figure5_slopes")
FIGURES = tuple(f"{name}.{suffix}" for name in FIGURE_NAMES for suffix in ("png", "svg"))
# of these, and of no others, the bytes differ from run to run
TIMED = (TIMING_TABLE, f"{TIMES}.png", f"{TIMES}.svg", TIMING)
STUDY_NAMES = (TRIALS, SCENES, *FIGURES, *TIMED, SUMMARY)  # the summary comes last: where it is, the others are


def write_study(
    study: Study,
    spread: Spread,
    claims: Sequence[Claim],
    timings: Sequence[Timing],
    timed: Sequence[Claim],
    directory: str,
) -> list[Path]:
    """Write the tables, figures and summaries of a study to a folder as `store_outputs`; returns the paths."""
    contents = {SUMMARY: summary_json(study, spread, claims), TRIALS: trials_csv(study), SCENES: scenes_csv(study)}
    contents |= draw_figures(study, spread)
    if timings:
        contents |= {TIMING: timing_json(timings, timed), TIMING_TABLE: _csv(Timing._fields, timings)}
        contents |= draw_times(timings)
    return store_outputs(contents, directory, STUDY_NAMES)


def trials_csv(study: Study) -> bytes:
    """One row for every solver on every scene: errors in degrees, empty where there is no answer."""
    windows = range(int(np.prod(study.options.grid)))
    head = ["trajectory_deg", "noise_px", "terrain", "solver", "rotation_error_deg", "translation_error_deg"]
    head += [f"slope_error_deg_window_{w}" for w in windows] + ["iterations", "converged", "reason"]
    rows = (
        [t.trajectory_deg, t.noise_px, t.terrain, t.solver]
        + [math.degrees(error) for error in (t.rotation_error, t.direction_error, *t.normal_errors)]
        + [t.iterations, int(t.converged), t.reason or ""]
        for t in study.trials
    )
    return _csv(head, rows)


def scenes_csv(study: Study) -> bytes:
    """One row for every scene: the least RMS errors that can be reached and the true slopes, degrees."""
    windows = range(int(np.prod(study.options.grid)))
    head = ["trajectory_deg", "noise_px", "terrain", "rotation_bound_deg", "translation_bound_deg"]
    head += [f"slope_bound_deg_window_{w}" for w in windows] + [f"true_slope_deg_window_{w}" for w in windows]
    rows = (
        [b.trajectory_deg, b.noise_px, b.terrain]
        + [math.degrees(value) for value in (b.rms[0], b.rms[1], *b.rms[2], *b.slopes)]
        for b in study.bounds
    )
    return _csv(head, rows)


def summary_json(study: Study, spread: Spread, claims: Sequence[Claim]) -> bytes:
    """Whether each claim held, the options, and mean and RMS errors of every solver; the same study, the same bytes."""
    document = {
        "schema_version": "1.0",
        "slopemap_version": __version__,
        "claims": [asdict(claim) for claim in claims],
        "options": asdict(study.options),
        "camera": asdict(study.camera),
        "scenes": len(study.bounds),
        "alignment": {"off_line_before_px": spread.off_line_before, "off_line_after_px": spread.off_line_after},
        "solvers": {solver: _solver_summary(study, solver) for solver in study.options.solvers},
        "bound": {_name(q): np.degrees(rms(study.bound(q), 2)) for q in QUANTITIES},
    }
    return (to_json(document) + "\n").encode("ascii")


def _solver_summary(study: Study, solver: str) -> dict[str, Any]:
    trials = [trial for trial in study.trials if trial.solver == solver]
    return {
        "trials": len(trials),
        "answered": sum(trial.reason is None for trial in trials),
        "converged": sum(trial.converged for trial in trials),
        "mean": {_name(q): np.degrees(mean(study.errors(solver, q), 2)) for q in QUANTITIES},
        "rms": {_name(q): np.degrees(rms(study.errors(solver, q), 2)) for q in QUANTITIES},
        "rms_over_bound": {_name(q, ""): _ratios(study, solver, q) for q in QUANTITIES},
    }


def _ratios(study: Study, solver: str, quantity: str) -> FloatArray | None:
    try:
        return bound_ratios(study, solver, quantity)
    except CannotTell:
        return None


def _name(quantity: str, unit: str = "_deg") -> str:
    """[trajectory][noise], and of slopes [window]."""
    return {"rotation_error": "rotation", "direction_error": "translation", "normal_errors": "slopes"}[quantity] + unit


def timing_json(timings: Sequence[Timing], claims: Sequence[Claim]) -> bytes:
    """What was measured of time, and whether it is as claimed."""
    document = {"claims": [asdict(claim) for claim in claims], "timings": [timing._asdict() for timing in timings]}
    return (to_json(document) + "\n").encode("ascii")


def _csv(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    table = StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return table.getvalue().encode("utf-8")


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.{SIGNIFICANT_DIGITS}g}" if math.isfinite(value) else ""
    return value
