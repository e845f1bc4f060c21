"""Slope maps against the true ground: errors, sigmas, verdicts and landing sites, at every cell.

    python benchmarks/map.py [--footprint PX ...] [--only TEXT] [--no-sgbm] [--into docs/map.md]

Maps the sample pair and, with SLOPEMAP_DATA, rendered pairs below it that have a depth at every pixel: facets, craters
and rocks (A), a descent of twelve images (E01, each with the next), boulders (D10), and a platform above flat ground
(C07, C08). The true plane of a cell is the nearest, by perpendicular distance, to all ground of its disc, shown by
image 2 or not; slopes are against the true vertical, which is given with --up. The same cells are asked of OpenCV's
semi-global matcher on rectified images (`rectified_stereo.py`). --into writes the tables between the marks of a
document.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from unittest import mock

import numpy as np
from documents import write_between
from numpy.typing import NDArray
from rectified_stereo import stereo_points
from true_ground import DiscPlanes, FloatArray, TrueGround, disc_planes, true_grounds

from slopecli.ground import SlopeMap, cell_map, footprint_planes
from slopecli.options import MapOptions, Options
from slopecli.pipeline import slope_map

# beginnings of the names of rendered pairs, and the row of the tables that they are in
SETS = {
    "A0": "A, facets and rocks",
    "E01": "E01, a descent",
    "D10": "D10, boulders",
    "C07": "C07, C08, a platform",
    "C08": "C07, C08, a platform",
}
FOOTPRINTS_PX = (32, 64, 96)
SGBM_PX = 64  # footprint at which the semi-global matcher is asked
ELLIPSE_95 = 5.991  # chi-square of two degrees of freedom
GENTLE_DEG = 10.0
BINS = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999, 1.0)  # edges of P(safe) in the table of its calibration


@dataclass(frozen=True, eq=False)
class Judged:
    """A map at one footprint, and the truth: arrays of the cells with true ground, NaN without an answer.

    chi2 : of the tilt's error under its covariance.  stereo_deg : slope by the semi-global matcher.
    shown : whether image 2 shows as much of the footprint as is needed.  sites : whether each is wholly safe.
    """

    set_name: str
    footprint_px: int
    true_deg: FloatArray
    slope_deg: FloatArray
    sigma_deg: FloatArray
    p_safe: FloatArray
    step: NDArray[np.bool_]
    chi2: FloatArray
    stereo_deg: FloatArray
    shown: NDArray[np.bool_]
    sites: list[bool]

    @property
    def answered(self) -> NDArray[np.bool_]:
        return np.isfinite(self.slope_deg)


def judge(ground: TrueGround, footprint_px: int, with_sgbm: bool) -> Judged:
    """Map one pair and compare it with its ground."""
    options = Options(up=tuple(float(c) for c in ground.up))
    with mock.patch.object(cell_map, "tilts", wraps=cell_map.tilts) as measured:
        answer = slope_map(
            *ground.images, ground.camera, ground.camera, options, MapOptions(footprint_px=float(footprint_px))
        )
    normals, covariance = measured.call_args_list[0].args[:2]
    truth = disc_planes(ground.points, answer.spacing_px, footprint_px)
    true_deg = truth.slope_deg(ground.up)
    seen = disc_planes(np.where(ground.visible[..., None], ground.points, np.nan), answer.spacing_px, footprint_px)
    stereo = np.full(true_deg.shape, np.nan)
    if with_sgbm:
        stereo = _by_sgbm(ground, answer, footprint_px)
    where = (truth.share >= footprint_planes.LEAST_SHARE) & np.isfinite(true_deg)
    with np.errstate(invalid="ignore"):
        chi2 = _chi_square(normals, covariance, truth.normal)
    return Judged(
        ground.set_name,
        footprint_px,
        true_deg[where],
        answer.slope_deg[where],
        answer.sigma_deg[where],
        answer.p_safe[where],
        answer.step[where],
        chi2[where],
        stereo[where],
        (seen.share >= footprint_planes.LEAST_SHARE)[where],
        _whole_sites(answer, true_deg),
    )


def _chi_square(normals: FloatArray, covariance: FloatArray, true_normal: FloatArray) -> FloatArray:
    """(rows, columns) of the errors of normals about two axes; normals and covariance are those of scaled normals."""
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    unit = -normals / length
    first = np.cross(unit, np.where(np.abs(unit[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    axes = np.stack([first, np.cross(unit, first)], -2)
    error = (axes @ true_normal[..., None])[..., 0]
    spread = axes @ covariance @ axes.swapaxes(-1, -2) / length[..., None] ** 2
    (a, b), (_, d) = np.moveaxis(spread, (-2, -1), (0, 1))
    return (d * error[..., 0] ** 2 - 2 * b * error[..., 0] * error[..., 1] + a * error[..., 1] ** 2) / (a * d - b * b)


def _by_sgbm(ground: TrueGround, answer: SlopeMap, footprint_px: int) -> FloatArray:
    """(rows, columns) slopes by the semi-global matcher with the motion and the range of depths of our answer."""
    motion = answer.report.motion
    known = answer.points[np.isfinite(answer.points).all(axis=2)]
    points = stereo_points(
        ground.images,
        ground.camera,
        np.array(motion.rotation_cam2_from_cam1),
        np.array(motion.baseline_cam1),
        known,
    )
    planes: DiscPlanes = disc_planes(points, answer.spacing_px, footprint_px)
    return np.where(planes.share >= footprint_planes.LEAST_SHARE, planes.slope_deg(ground.up), np.nan)


def _whole_sites(answer: SlopeMap, true_deg: FloatArray) -> list[bool]:
    """Of every site, whether all footprints whose ground lies in it are truly no steeper than the tolerance."""
    rows, columns = np.indices(true_deg.shape)
    whole = []
    for site in answer.sites:
        u, v = site.centre_px
        px = [(n + 0.5) * answer.spacing_px - 0.5 for n in (columns, rows)]
        inside = np.hypot(px[0] - u, px[1] - v) <= site.radius_px - 0.5 * answer.footprint_px + 1e-6
        whole.append(bool((true_deg[inside] <= answer.tolerance_deg).all()))
    return whole


# ---- tables ----

ERRORS = ["ground", "footprint", "cells", "shown", "answered", "error, median", "90 %", "σ, median"]
ERRORS += ["within 1 σ", "2 σ", "3 σ", "95 % ellipse"]
VERDICTS = ["ground", "footprint", "undecided", "steep called safe", "gentle called safe", "sites wholly safe"]
LIMIT_DEG, CONFIDENCE = Options().tolerance_deg, Options().confidence


def errors(group: Sequence[Judged]) -> list[str]:
    """Cells of a row: how well slopes are known of the pairs of a set at one footprint."""
    one = _joined(group)
    told = one.answered
    error = np.abs(one.slope_deg - one.true_deg)[told]
    z = error / one.sigma_deg[told]
    return [
        one.set_name,
        f"{one.footprint_px} px",
        str(len(told)),
        percent(one.shown.sum(), len(told)),
        percent(told.sum(), len(told)),
        f"{np.median(error):.2f}°",
        f"{np.quantile(error, 0.9):.2f}°",
        f"{np.median(one.sigma_deg[told]):.2f}°",
        *(percent((z <= k).sum(), len(z)) for k in (1, 2, 3)),
        percent((one.chi2[told] <= ELLIPSE_95).sum(), len(z)),
    ]


def verdicts(group: Sequence[Judged]) -> list[str]:
    """Cells of a row: what is called safe and should be."""
    one = _joined(group)
    told, safe, unsafe = one.answered, one.p_safe >= CONFIDENCE, one.p_safe <= 1.0 - CONFIDENCE
    steep, gentle = told & (one.true_deg > LIMIT_DEG), told & (one.true_deg < GENTLE_DEG)
    wrong = steep & safe
    worst = f", worst {one.true_deg[wrong].max():.1f}°" if wrong.any() else ""
    return [
        one.set_name,
        f"{one.footprint_px} px",
        percent((told & ~safe & ~unsafe).sum(), told.sum()),
        f"{wrong.sum()} of {steep.sum()}{worst}",
        percent((gentle & safe).sum(), gentle.sum()),
        f"{sum(one.sites)} of {len(one.sites)}",
    ]


def _joined(group: Sequence[Judged]) -> Judged:
    first = group[0]
    names = ("true_deg", "slope_deg", "sigma_deg", "p_safe", "step", "chi2", "stereo_deg", "shown")
    arrays = (np.concatenate([getattr(one, name) for one in group]) for name in names)
    return Judged(first.set_name, first.footprint_px, *arrays, [ok for one in group for ok in one.sites])


def calibration(results: Sequence[Judged]) -> str:
    """What share of the cells of a P(safe) is truly no steeper than the tolerance; cells over steps are left out."""
    one = _joined(results)
    told = one.answered & ~one.step
    p, gentle = one.p_safe[told], one.true_deg[told] <= LIMIT_DEG
    rows = []
    for low, high in pairwise(BINS):
        here = (p >= low) & ((p < high) | (high == BINS[-1]))
        if here.any():
            rows.append(
                [f"{low:g} to {high:g}", str(here.sum()), f"{p[here].mean():.4f}", f"{gentle[here].mean():.4f}"]
            )
    return markdown(["P(safe)", "cells", "mean P(safe)", f"truly at most {LIMIT_DEG:g}°"], rows)


def comparison(results: Sequence[Judged]) -> str:
    """slopemap beside the semi-global matcher, set by set."""
    head = ["ground", "answered, slopemap", "SGBM", "ratio", "cells of both", "median error, slopemap", "SGBM", "ratio"]
    rows = []
    for group in _grouped(results, lambda one: one.set_name):
        one = _joined(group)
        ours, theirs = one.answered, np.isfinite(one.stereo_deg)
        both = ours & theirs
        cells = [one.set_name, percent(ours.sum(), len(ours)), percent(theirs.sum(), len(ours))]
        cells.append(f"{ours.sum() / theirs.sum():.2f}" if theirs.any() else "-")
        medians = [
            np.median(np.abs(slope - one.true_deg)[both]) if both.any() else np.nan
            for slope in (one.slope_deg, one.stereo_deg)
        ]
        cells.append(str(both.sum()))
        cells += [f"{median:.2f}°" if both.any() else "-" for median in medians]
        rows.append([*cells, f"{medians[0] / medians[1]:.2f}" if both.any() else "-"])
    return markdown(head, rows)


def _grouped(results: Sequence[Judged], key: Callable[[Judged], object]) -> list[list[Judged]]:
    return [[one for one in results if key(one) == name] for name in dict.fromkeys(map(key, results))]


def percent(count: float, total: float) -> str:
    return f"{100 * count / total:.1f} %" if total else "-"


def markdown(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join("| " + " | ".join(line) + " |" for line in [head, ["---"] * len(head), *rows])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--footprint", type=int, action="append", metavar="PX", help="repeat for more; 32, 64 and 96")
    parser.add_argument("--only", default="", metavar="TEXT", help="pairs whose name holds TEXT")
    parser.add_argument("--no-sgbm", action="store_true", help="without the semi-global matcher")
    parser.add_argument("--into", type=Path, metavar="FILE")
    options = parser.parse_args()
    data = os.environ.get("SLOPEMAP_DATA")
    results = []
    for ground in true_grounds(Path(data) if data else None, SETS, options.only):
        print(ground.name, file=sys.stderr)
        for footprint in options.footprint or FOOTPRINTS_PX:
            results.append(judge(ground, footprint, footprint == SGBM_PX and not options.no_sgbm))
    groups = _grouped(results, lambda one: (one.set_name, one.footprint_px))
    tables = {
        "map-errors": markdown(ERRORS, [errors(group) for group in groups]),
        "map-verdicts": markdown(VERDICTS, [verdicts(group) for group in groups]),
        "map-probability": calibration(results),
    }
    asked = [one for one in results if one.footprint_px == SGBM_PX]
    if asked and not options.no_sgbm:
        tables["map-sgbm"] = comparison(asked)
    print("\n\n".join(tables.values()))
    for name, table in tables.items() if options.into else ():
        write_between(options.into, name, table)


if __name__ == "__main__":
    main()
