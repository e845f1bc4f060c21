"""How often a false focal length is noticed on pairs with known truth, and what it does to slopes.

    python benchmarks/cameras.py [--only TEXT] [--factors 1,0.6,0.8,0.9,1.1,1.3] [--free-focal] [--focal-sigma PERCENT]
                                 [--into docs/cameras.md]

The pairs lie below SLOPEMAP_DATA, as for accuracy.py. Each is answered in this process with its true focal length times
every factor; with --focal-sigma also with a factor drawn at random from that distribution (seeded). A row a factor
and kind of pair: pairs answered, flagged, those that tell the focal length to 1 % and are flagged, the median error of
normals, windows within 2 sigma, those within 2 sigma of answer and truth together (the truth of photographs has a
sigma of its own), and windows truly steeper than 16 degrees that are called safe, flagged or not. Then
the pairs that cannot tell. --into writes the table between the marks of a document.
"""

from __future__ import annotations

import argparse
import math
import sys
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from accuracy import TruePair, angle_deg, data_folder, markdown, true_pairs
from documents import write_between

from slopecli import Camera, Options, estimate, load_image
from slopecli.errors import SlopemapError

STEEP_DEG = 16.0
SUSPICIONS = {"suspect-camera", "suspect-distortion"}


@dataclass(frozen=True)
class Judged:
    """One pair under one factor: what was said, and per answered window its error, sigma of the slope, that with the
    sigma of the truth, error of the slope, all in degrees, whether it is truly steep, and whether it is called safe."""

    name: str
    kind: str
    flagged: bool
    factor_sigma: float
    windows: list[tuple[float, float, float, float, bool, bool]]


def camera_of(given: dict[str, Any], factor: float) -> Camera:
    K, lens = np.array(given["K"], float), tuple(given["distortion"])
    model = "brown" if any(lens) else "pinhole"
    numbers = factor * K[0, 0], factor * K[1, 1], K[0, 2], K[1, 2]
    return Camera(given["width"], given["height"], *numbers, model, lens if any(lens) else ())


def judged(pair: TruePair, factor: float, options: Options) -> Judged | None:
    """The pair answered with its focal lengths times a factor; None where it is refused."""
    images = load_image(pair.image1), load_image(pair.image2)
    first, second = (camera_of(given, factor) for given in pair.cameras)
    try:
        report = estimate(*images, first, second, replace(options, windows=tuple(pair.windows)))
    except SlopemapError:
        return None
    windows = []
    for plane in report.planes:
        if plane.id <= len(pair.normals):
            normal = pair.normals[plane.id - 1] / np.linalg.norm(pair.normals[plane.id - 1])
            slope = math.degrees(math.acos(float(np.clip(-normal[2], -1.0, 1.0))))
            error, off = angle_deg(plane.normal_cam1, normal), abs((plane.slope_deg or 0.0) - slope)
            sigma = plane.slope_sigma_deg or 0.0
            together = math.hypot(sigma, pair.normal_sigmas_deg[plane.id - 1])
            windows.append((error, sigma, together, off, slope > STEEP_DEG, plane.verdict == "safe"))
    flagged = bool(SUSPICIONS & {d.code for d in report.diagnostics})
    kind = pair.set_name.split()[0]
    return Judged(pair.name, kind, flagged, report.fit.focal_factor_sigma or math.inf, windows)


def row(label: str, kind: str, found: list[Judged]) -> list[str]:
    sure = [one for one in found if one.factor_sigma < 0.01]
    windows = [window for one in found for window in one.windows]
    quiet = [window for one in found if not one.flagged for window in one.windows]
    errors = [window[0] for window in windows]
    within = [np.mean([w[3] <= 2.0 * w[k] for w in windows]) if windows else math.nan for k in (1, 2)]
    steep = f"{sum(s and safe for *_, s, safe in windows)} of {sum(s for *_, s, _ in windows)}"
    unsaid = f"{sum(s and safe for *_, s, safe in quiet)} of {sum(s for *_, s, _ in quiet)}"
    told = f"{sum(one.flagged for one in sure)} of {len(sure)}"
    median = f"{np.median(errors):.2f}" if errors else "-"
    flagged = f"{sum(one.flagged for one in found)} of {len(found)}"
    return [label, kind, flagged, told, median, *(f"{100 * share:.0f} %" for share in within), steep, unsaid]


HEAD = [
    *("f times", "pairs", "flagged", "of those to 1 %", "median error"),
    *("2 sigma", "with the truth's", "steep called safe", "not flagged"),
]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="TEXT")
    parser.add_argument("--factors", default="1,0.6,0.8,0.9,1.1,1.3", metavar="F,F")
    parser.add_argument("--free-focal", action="store_true")
    parser.add_argument("--focal-sigma", type=float, metavar="PERCENT")
    parser.add_argument("--into", type=Path, metavar="FILE")
    chosen = parser.parse_args()
    if (data := data_folder()) is None:
        return
    options = Options(free_focal=chosen.free_focal, focal_sigma_percent=chosen.focal_sigma)
    pairs = [pair for pair in true_pairs(data, chosen.only) if not pair.expected and pair.windows]
    labels = [*chosen.factors.split(","), *(["random"] if chosen.focal_sigma else [])]
    rows, untold = [], set[str]()
    for label in labels:
        found = []
        for pair in pairs:
            rng = np.random.default_rng(zlib.crc32(pair.name.encode()))
            drawn = math.exp(0.01 * (chosen.focal_sigma or 0.0) * rng.standard_normal())
            one = judged(pair, drawn if label == "random" else float(label), options)
            print(label, pair.name, one and (one.flagged, round(one.factor_sigma, 4)), file=sys.stderr)
            found += [one] if one else []
        rows += [row(label, kind, [one for one in found if one.kind == kind]) for kind in ("rendered", "real")]
        untold |= {one.name for one in found if math.isinf(one.factor_sigma)} if label == "1" else set()
    table = f"{markdown(HEAD, rows)}\n\nCannot tell the focal length: {', '.join(sorted(untold)) or 'none'}"
    print(table)
    if chosen.into:
        write_between(chosen.into, "cameras", table)


if __name__ == "__main__":
    main()
