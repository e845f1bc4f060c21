"""What `slopemap plan` predicts against what `slopemap estimate` then reports, pair by pair.

SLOPEMAP_DATA=FOLDER python benchmarks/plan.py

Every pair is answered in a grid of 3x3 windows; the plan is given the planes and the motion found. Printed is the
median sigma reported over the median sigma predicted, with the noise and roughness that were found, and with the
plan's defaults. A plan has the camera keep its attitude: pairs between which it turned so far that the plan sees no
common ground are left out, as are pairs without three good windows.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from accuracy import TruePair, true_pairs

from slopecli.errors import SlopemapError
from slopecli.io import load_image
from slopecli.io.cameras import decode_camera
from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.plan import Flight, Window, forecast
from slopecli.types import Camera, FloatArray, Plane, Report

SETS = ("rendered/A", "rendered/D", "drone")  # ground from above, what the plan is for
LEAST_WINDOWS = 3


def main() -> None:
    data = os.environ.get("SLOPEMAP_DATA")
    if not data:
        sys.exit("set SLOPEMAP_DATA to a folder of pairs with truth")
    ratios = []
    print(f"{'pair':45s} {'noise, px':>9s} {'roughness':>9s} {'sigma':>6s} {'as found':>8s} {'defaults':>8s}")
    for pair in true_pairs(Path(data)):
        if any(name in str(pair.path) for name in SETS):
            ratios += list(compare(pair))
    found, plain = np.array(ratios).T
    print(
        f"{len(found)} pairs; as found: median {np.median(found):.2f}, {found.min():.2f} to {found.max():.2f}, ", end=""
    )
    print(f"{np.mean((found > 0.5) & (found < 2.0)):.0%} within a factor of 2; ", end="")
    print(f"defaults: median {np.median(plain):.2f}, {plain.min():.2f} to {plain.max():.2f}")


def compare(pair: TruePair) -> Iterator[tuple[float, float]]:
    """Reported over predicted sigma with noise and roughness as found, and with the defaults; none without a plan."""
    cameras = [_camera(camera) for camera in pair.cameras]
    try:
        images = load_image(str(pair.image1)), load_image(str(pair.image2))
        report = estimate(*images, *cameras, Options())
        planes = [plane for plane in report.planes if plane.status == "ok"]
        if len(planes) < LEAST_WINDOWS:
            return
        roughness = float(np.median([plane.roughness for plane in planes]))
        found = _predicted(report, planes, noise_px=report.fit.noise_px, roughness=roughness)
        plain = _predicted(report, planes)
    except SlopemapError:
        return
    reported = float(np.median([plane.slope_sigma_deg for plane in planes]))
    print(f"{pair.name:45s} {report.fit.noise_px:9.3f} {roughness:9.4f} {reported:6.3f} ", end="")
    print(f"{reported / found:8.2f} {reported / plain:8.2f}", flush=True)
    yield reported / found, reported / plain


def _camera(values: dict[str, object]) -> Camera:
    return decode_camera(json.dumps(values, default=list).encode(), "camera")


def _predicted(report: Report, planes: list[Plane], **values: float) -> float:
    """Median sigma, deg, of a plan with the planes and the motion of a report, whose lengths are in baselines."""
    normals = np.array([-plane.normal_cam1 / plane.distance for plane in planes])
    windows = [_window(plane.polygon_px) for plane in planes]
    up = np.array(report.up.vector_cam1)
    flight = Flight(report.cameras[0], windows, report.motion.baseline_cam1, normals, up, **values)  # type: ignore[arg-type]
    return float(np.degrees(np.nanmedian(forecast(flight, 1.0).sigma_rad)))


def _window(polygon: FloatArray) -> Window:
    (x0, y0), (x1, y1) = np.rint(polygon.min(axis=0) + 0.5), np.rint(polygon.max(axis=0) + 0.5)
    return int(x0), int(y0), int(x1 - x0), int(y1 - y0)


if __name__ == "__main__":
    main()
