"""Compare slopes.json with the sample's truth, window by window, or that of a map; exit 1 where an answer is wrong.

    python sample_data/check_demo.py SLOPES.json TRUTH.json

Wrong is: no answer, a normal more than 2 degrees off, or a slope further off than 4 of its own sigmas. True slopes
are taken against the up direction the answer used, so that only the normals are judged. Of a map, slopes in the middle
of nine discs of ground are judged likewise, and sites are wrong on windows that are steeper than the tolerance.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

MAX_NORMAL_ERROR_DEG = 2.0
MAX_SIGMAS = 4.0


def angle_deg(a: list[float], b: list[float]) -> float:
    """Angle between two vectors, well-conditioned at 0 and 180 degrees."""
    cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return math.degrees(math.atan2(math.hypot(*cross), sum(x * y for x, y in zip(a, b, strict=True))))


def judge(plane: dict[str, Any] | None, window: dict[str, Any], up: list[float]) -> tuple[str, bool]:
    """One line of the comparison, and whether the answer is right."""
    true_slope = angle_deg(window["normal_cam1"], up)
    if plane is None:
        return f"{true_slope:9.2f}   no answer", False
    slope, sigma = plane["slope_deg"], plane["slope_sigma_deg"]
    normal_error = angle_deg(plane["normal_cam1"], window["normal_cam1"])
    right = normal_error <= MAX_NORMAL_ERROR_DEG and abs(slope - true_slope) <= MAX_SIGMAS * sigma
    line = f"{true_slope:9.2f} {slope:9.2f} ± {sigma:4.2f} {slope - true_slope:+9.2f} {normal_error:9.2f}"
    return f"{line}   {'ok' if right else 'WRONG'}", right


def judge_map(slopes: dict[str, Any], truth: dict[str, Any], folder: Path) -> int:
    """Print the comparison of a map; 1 where a slope or a site is wrong. folder : of its files."""
    import tifffile  # only maps need it

    about, tolerance = slopes["map"], slopes["options"]["tolerance_deg"]
    bands = dict(zip(about["bands"], tifffile.imread(folder / about["file"]), strict=True))
    right = []
    print("disc   true slope   estimated    error, degrees")
    for disc in truth["discs"]:
        cell = disc["v"] // about["spacing_px"], disc["u"] // about["spacing_px"]
        slope, sigma = (float(bands[name][cell]) for name in ("slope_deg", "slope_sigma_deg"))
        true_slope = angle_deg(disc["normal_cam1"], slopes["up"]["vector_cam1"])
        right.append(abs(slope - true_slope) <= min(MAX_SIGMAS * sigma, MAX_NORMAL_ERROR_DEG))
        word = "ok" if right[-1] else "WRONG"
        print(f"{disc['id']:4d} {true_slope:12.2f} {slope:9.2f} ± {sigma:4.2f} {slope - true_slope:+8.2f}   {word}")
    gentle = [true_slope_at(site["centre_px"], truth) <= tolerance for site in slopes["sites"]]
    print(f"{sum(right)} of {len(right)} discs within {MAX_NORMAL_ERROR_DEG:g} degrees and {MAX_SIGMAS:g} sigma")
    print(f"{sum(gentle)} of {len(gentle)} sites in windows of at most {tolerance:g} degrees")
    return 0 if all(right) and gentle and all(gentle) else 1


def true_slope_at(place_px: list[float], truth: dict[str, Any]) -> float:
    """Slope of the window of the grid that a place of image 1 is in, degrees."""
    u, v = place_px
    (slope,) = (
        w["slope_deg"]
        for w in truth["windows"]
        if -0.5 <= u - w["x"] < w["w"] - 0.5 and -0.5 <= v - w["y"] < w["h"] - 0.5
    )
    return float(slope)


def main(slopes_path: str, truth_path: str) -> int:
    slopes, truth = (json.loads(Path(path).read_text(encoding="utf-8")) for path in (slopes_path, truth_path))
    if "map" in slopes:
        return judge_map(slopes, truth, Path(slopes_path).parent)
    planes = {plane["id"]: plane for plane in slopes["planes"]}
    verdicts = []
    print("window   true slope   estimated    error    normal error, degrees")
    for window in truth["windows"]:
        line, right = judge(planes.get(window["id"]), window, slopes["up"]["vector_cam1"])
        print(f"{window['id']:6d} {line}")
        verdicts.append(right)
    print(
        f"{sum(verdicts)} of {len(verdicts)} windows within {MAX_NORMAL_ERROR_DEG:g} degrees and {MAX_SIGMAS:g} sigma"
    )
    return 0 if all(verdicts) else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
