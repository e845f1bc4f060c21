"""validation.png: the paper's Figures 8 and 9, patches over the true ground in space, and the differences of slopes."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.products.drawing.plots import plot_settings
from slopecli.products.model_frame import level_axes
from slopecli.types import FloatArray
from slopecli.validate.comparison import Comparison
from slopecli.validate.finished_result import Result, ResultPlane
from slopecli.validate.truth import Truth

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GROUND, ANSWER, SIGMA = "#7f7f7f", "#D55E00", "#0072B2"  # safe for the colour-blind: Okabe and Ito


def draw_validation(result: Result, truth: Truth, comparison: Comparison) -> bytes:
    """Return the picture as PNG; the same comparison gives the same bytes."""
    from matplotlib.figure import Figure

    with plot_settings():
        figure = Figure(figsize=(13.0, 6.0), layout="constrained")
        left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
        _draw_differences(left, comparison)
        _draw_space(right, result, truth, comparison)
        buffer = BytesIO()
        figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def _draw_differences(axes: Axes, comparison: Comparison) -> None:
    """The paper's Figure 9: slope less true slope of every patch, with 2 sigma."""
    patches = comparison.patches
    places = np.arange(len(patches))
    off = np.array([one.difference_deg for one in patches])
    sigma = np.array([one.sigma_deg if one.sigma_deg is not None else np.nan for one in patches])
    axes.bar(places, off, color=ANSWER, label="slope less true slope")
    axes.errorbar(places, off, 2.0 * sigma, fmt="none", ecolor=SIGMA, capsize=3.0, label="2 sigma of the answer")
    axes.axhline(0.0, color="black", linewidth=0.8)
    step = -(-len(patches) // 24)  # as many ids as there is room for
    axes.set_xticks(places[::step], [str(one.id) for one in patches[::step]])
    most = 1.25 * float(np.quantile(np.abs(off) + 2.0 * np.nan_to_num(sigma), 0.95)) or 1.0
    axes.set_ylim(-most, most)
    axes.set(title="Difference of the slopes", xlabel="patch", ylabel="degrees")
    axes.legend(frameon=False)


def _draw_space(axes: Any, result: Result, truth: Truth, comparison: Comparison) -> None:
    """The paper's Figure 8: the patches over the points of the truth, in the unit of the truth, seen from the side."""
    axes_of = level_axes(result.up)  # more than some thousand points only take time
    some = truth.points[:: max(1, len(truth.points) // 6000)] @ axes_of.T
    axes.scatter(*some.T, s=1.0, color=GROUND, linewidths=0.0)
    planes = {plane.id: plane for plane in result.planes}
    shown = [_outline(planes[one.id], result, comparison.scale) @ axes_of.T for one in comparison.patches]
    for outline in shown:
        axes.plot(*np.vstack([outline, outline[:1]]).T, color=ANSWER, linewidth=1.5)
    cameras = np.stack([np.zeros(3), axes_of @ result.baseline_cam1 * comparison.scale])
    axes.scatter(*cameras.T, marker="^", color=SIGMA, s=40.0)
    for number, camera in enumerate(cameras, 1):
        axes.text(*camera, f"  camera {number}", fontsize=9.0)
    everything = np.vstack([some, *shown])
    low, high = np.quantile(everything, [0.005, 0.995], axis=0)
    low, high = np.minimum(low, cameras.min(axis=0)), np.maximum(high, cameras.max(axis=0))
    room = 0.02 * float((high - low).max())
    axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))
    axes.set_zlim(low[2] - room, high[2] + room)
    axes.set_box_aspect(high - low + 2.0 * room, zoom=1.1)
    axes.set(title="Patches (orange) over the truth (grey)", xlabel="right", ylabel="forward", zlabel="up")
    axes.tick_params(labelsize=9.0)
    axes.view_init(elev=18.0, azim=-60.0)


def _outline(plane: ResultPlane, result: Result, scale: float) -> FloatArray:
    """(k, 3) the corners of a patch on its plane, in the unit of the truth."""
    rays = homogeneous(rays_from_pixels(result.cameras[0], plane.polygon_px))
    normal = plane.normals[0]
    away = -plane.distance * scale / (rays @ normal)
    points = rays * away[:, None]
    return points[np.isfinite(points).all(axis=1) & (away > 0)]
