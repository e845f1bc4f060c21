"""The figures of a simulation study (the paper's Figures 2, 4, 5 and 6), drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from slopecli.products.drawing.plots import plot_settings
from slopecli.study.claims import LINEAR_FROM, USUAL_PX, mean, time_exponent
from slopecli.study.trials import Spread, Study, Timing
from slopecli.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL_IN = 3.4  # side of a panel
NO_NOISE = "This study has no noise:\nall errors are rounding,\nand nothing is left to draw."
# solver -> what it is called, its colour (safe for the colour-blind: Okabe and Ito), line, marker
STYLES: dict[str, tuple[str, dict[str, Any]]] = {
    "lh": ("averaged Longuet-Higgins", {"color": "#D55E00", "linestyle": "--", "marker": "s"}),
    "ha": ("homography alignment", {"color": "#0072B2", "linestyle": "-", "marker": "o"}),
    "mle": ("joint maximum likelihood", {"color": "#009E73", "linestyle": "-", "marker": "D"}),
}
Unit = Callable[[FloatArray], FloatArray]  # of an error, from rad
# the paper's limits of the errors at `USUAL_PX`; of rotation 0.1 deg
PRINTED_TRANSLATION_PERCENT = {0.0: 0.5, 45.0: 0.25, 90.0: 0.25}  # by trajectory
PRINTED_SLOPE_DEG = {3: 0.5, 4: 1.0, 5: 1.0}  # by window; those shown
TIMES = "figure6_time"


def draw_figures(study: Study, spread: Spread) -> dict[str, bytes]:
    """Figures 2, 4 and 5 of the paper by file name, each as PNG and as SVG; the same study gives the same bytes."""
    with plot_settings():
        figures = _encoded("figure2_alignment", _draw_spread(spread)) | _encoded("figure4_motion", _draw_motion(study))
        return figures | _encoded("figure5_slopes", _draw_slopes(study))


def draw_times(timings: Sequence[Timing]) -> dict[str, bytes]:
    """Figure 6 as PNG and as SVG: time against the number of windows."""
    with plot_settings():
        return _encoded(TIMES, _draw_times(timings))


def _panels(rows: int, columns: int, **attributes: Any) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PANEL_IN * columns + 0.8, PANEL_IN * rows + 0.9), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **attributes)


def _encoded(name: str, figure: Figure) -> dict[str, bytes]:
    contents = {}
    # no date and no version of the program that drew it
    for suffix, metadata in (("png", {"Software": None}), ("svg", {"Date": None, "Creator": None})):
        buffer = BytesIO()
        figure.savefig(buffer, format=suffix, dpi=120, metadata=metadata)
        contents[f"{name}.{suffix}"] = buffer.getvalue()
    return contents


def _legend(figure: Figure, axes: Any, columns: int | None = None) -> None:
    """Put a legend below the panels; columns None: as many as there is width for, and the figure grows in height."""
    handles: dict[str, Any] = {}
    for panel in axes.flat:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if not handles:
        return
    if columns is None:
        width, height = figure.get_size_inches()
        columns = min(max(int(width / 3.3), 1), 3)  # the longest name takes 3.3 inches
        lines = -(-len(handles) // columns)
        figure.set_size_inches(width, height + max(lines - 2, 0) * 0.28)  # the panels leave room for two lines
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=columns, frameon=False)


def _draw_spread(spread: Spread) -> Figure:
    figure, axes = _panels(1, 2, sharey=True, sharex=True)
    before = "each window by itself", spread.before, spread.off_line_before
    after = "after alignment", spread.after, spread.off_line_after
    for panel, (title, points, off) in zip(axes[0], (before, after), strict=True):
        panel.plot(*points.T, **{**STYLES["ha"][1], "linestyle": "none", "markersize": 8.0})
        for rank, number in enumerate(np.argsort(points[:, 0])):  # neighbours would hide each other's number
            place = {"xytext": (0, (10, -20, 24)[rank % 3]), "textcoords": "offset points", "ha": "center"}
            panel.annotate(str(number), points[number], fontsize=11, **place)
        panel.set_title(f"{title}:\n{off if off >= 0.005 else 0.0:.2f} px off one line (RMS)")
        x, y = map(float, np.linalg.svd(points)[2][0])  # along the best line through the points
        panel.axline((0.0, 0.0), slope=y / x, color="grey", linewidth=1.2, zorder=1)
        panel.set_xlabel("image x, px from the mean")
        panel.grid(alpha=0.4)
    reach = 1.6 * float(np.abs(spread.before[:, 1]).max())
    axes[0, 0].set_ylim(-reach, reach)
    axes[0, 0].set_ylabel("image y, px from the mean")
    figure.suptitle("Where nine homographies send the image's middle", fontsize=14)
    return figure


def _draw_motion(study: Study) -> Figure:
    figure, axes = _panels(2, len(study.options.trajectories_deg), sharex=True, sharey="row")
    for i, angle in enumerate(study.options.trajectories_deg):
        _curves(axes[0, i], study, "rotation_error", np.degrees, i)
        _printed(axes[0, i], study, 0.1)
        _curves(axes[1, i], study, "direction_error", lambda errors: 100.0 * errors, i)
        _printed(axes[1, i], study, PRINTED_TRANSLATION_PERCENT.get(angle))
    axes[0, 0].set_ylabel("rotation error, deg")
    axes[1, 0].set_ylabel("translation error, %")
    return _finished(figure, axes, study)


def _draw_slopes(study: Study) -> Figure:
    windows = [w for w in PRINTED_SLOPE_DEG if w < np.prod(study.options.grid)] or [0]
    figure, axes = _panels(len(windows), len(study.options.trajectories_deg), sharex=True, sharey=True)
    for line, window in zip(axes, windows, strict=True):
        for i, panel in enumerate(line):
            _curves(panel, study, "normal_errors", np.degrees, i, window)
            _printed(panel, study, PRINTED_SLOPE_DEG.get(window))
        line[0].set_ylabel(f"window {window}:\nslope error, deg")
    return _finished(figure, axes, study)


def _finished(figure: Figure, axes: Any, study: Study) -> Figure:
    """The figure with the names of the trajectories above, of the noise below, and a legend."""
    names = {0.0: " (vertical)", 45.0: " (gliding)", 90.0: " (level)"}
    for panel, angle in zip(axes[0], study.options.trajectories_deg, strict=True):
        panel.set_title(f"{angle:g}°{names.get(angle, '')}")
    for panel in axes[-1]:
        panel.set_xlabel("noise, px")
    _legend(figure, axes)
    return figure


def _curves(panel: Axes, study: Study, quantity: str, unit: Unit, trajectory: int, window: int | None = None) -> None:
    """Mean error of every solver, and at the bound, against noise; where there is none, errors are rounding."""
    noises = np.array(study.options.noises_px)
    noisy = noises > 0.0
    if not noisy.any():
        panel.set(xticks=[], yticks=[])
        panel.text(0.5, 0.5, NO_NOISE, ha="center", va="center", transform=panel.transAxes)
        return

    def line(errors: FloatArray) -> FloatArray:
        errors = errors[trajectory] if window is None else errors[trajectory, :, :, window]
        return unit(mean(errors)[noisy])

    bound: dict[str, Any] = {"color": "black", "linestyle": ":", "linewidth": 2.2, "zorder": 5}
    if noisy.sum() == 1:
        bound |= {"marker": "_", "markersize": 24.0, "markeredgewidth": 2.2}  # a line through one point is not seen
    for solver in STYLES:
        if solver in study.options.solvers:
            name, style = STYLES[solver]
            panel.plot(noises[noisy], line(study.errors(solver, quantity)), label=name, **style)
    panel.plot(noises[noisy], line(study.bound(quantity, "mean")), label="Cramér-Rao bound", **bound)
    panel.set_yscale("log")
    panel.get_yaxis().set_major_formatter("{x:g}")
    panel.grid(which="major", alpha=0.5)
    panel.grid(which="minor", alpha=0.2)


def _printed(panel: Axes, study: Study, value: float | None) -> None:
    """Mark a limit of the paper, if the study has the noise that it is for."""
    if value is not None and USUAL_PX in study.options.noises_px:
        style: dict[str, Any] = {"color": "#CC79A7", "marker": "v", "linestyle": "none", "markersize": 11, "zorder": 6}
        panel.plot([USUAL_PX], [value], label="not above this, as printed", **style)


def _draw_times(timings: Sequence[Timing]) -> Figure:
    figure, axes = _panels(1, 1)
    figure.set_size_inches(2.2 * PANEL_IN, 1.9 * PANEL_IN)
    panel = axes[0, 0]
    for solver, (name, style) in STYLES.items():
        own = [(timing.windows, timing.seconds) for timing in timings if timing.solver == solver]
        exponent = time_exponent(timings, solver)
        power = "" if exponent is None else f": windows$^{{{exponent:.2f}}}$ a sweep"
        if own:
            panel.plot(*zip(*own, strict=True), label=name + power, **style)
    most = max(timing.windows for timing in timings)
    if most > LINEAR_FROM:
        ends = np.array([LINEAR_FROM, most])
        start = min(timing.seconds for timing in timings if timing.windows == LINEAR_FROM)
        panel.plot(ends, start / 2.0 * ends / LINEAR_FROM, color="grey", linestyle=":", label="linear")
    panel.set(xscale="log", yscale="log", xlabel="windows", ylabel="processor time of one solution, s")
    panel.set_xticks(sorted({timing.windows for timing in timings}))
    panel.get_xaxis().set_major_formatter("{x:.0f}")
    panel.get_yaxis().set_major_formatter("{x:g}")
    panel.minorticks_off()
    panel.grid(alpha=0.5)
    _legend(figure, axes, columns=1)
    return figure
