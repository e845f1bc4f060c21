"""The table and the summary of `slopemap plan`."""

from __future__ import annotations

from collections.abc import Iterator

from slopecli.cli.table import Table
from slopecli.plan import Plan, PlannedWindow, sigma_text

HEADER = ("id", "sigma", "parallax", "in image 2", "note")


def plan_table(plan: Plan) -> Table:
    """A row for each window; angles in degrees."""
    return Table(HEADER, [_cells(one) for one in plan.windows])


def _cells(one: PlannedWindow) -> tuple[str, ...]:
    return (
        str(one.id),
        sigma_text(one.slope_sigma_deg),
        "-" if one.parallax_px is None else f"{one.parallax_px:.1f} px",
        f"{100 * one.share_in_image2:.0f} %",
        "; ".join(_notes(one)),
    )


def _notes(one: PlannedWindow) -> Iterator[str]:
    if one.reason:
        yield f"{'no answer' if one.status == 'refused' else one.status}: {one.reason}"
    if one.in_part:
        yield f"± {sigma_text(one.unseen_deg)} for the rest of it"


def plan_summary(plan: Plan) -> Iterator[str]:
    """Lines below the table: what holds for all windows."""
    yield f"baseline: {_baseline(plan)}"
    worst, median = sigma_text(plan.worst_sigma_deg), sigma_text(plan.median_sigma_deg)
    second = plan.second_answer
    of_two = ", if it is known which of two answers is right" if second.share else ""
    yield f"sigma: {worst} in the worst window, {median} in the median{of_two}"
    yield f"parallax: {plan.parallax_px:.1f} px in the median"
    said = "likely" if second.likely else "possible" if second.share else "unlikely"
    alone = f"; the first by itself is off by {sigma_text(second.first_error_deg)}" if second.share else ""
    yield f"two answers: {said} ({100 * second.share:.0f} % of simulated pairs){alone}"
    if any(one.in_part for one in plan.windows):
        yield "the rest: sigma is for the part of a window that image 2 shows; estimate adds uncertainty for the rest"


def _baseline(plan: Plan) -> str:
    share = f"{plan.baseline / plan.height:.3g} of the height"
    if plan.unit == "height":
        return share
    if plan.unit == "baseline":
        return f"{share}, which is {plan.height:.4g} baselines"
    return f"{plan.baseline:.4g} m, {share} of {plan.height:.4g} m"
