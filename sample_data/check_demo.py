"""Compare slopes.json with the sample's truth, window by window; exit 1 where an answer is wrong.

    python sample_data/check_demo.py SLOPES.json TRUTH.json

Wrong is: no answer, a normal more than 2 degrees off, or a slope further off than 4 of its own sigmas. True slopes
are taken against the up direction the answer used, so that only the normals are judged.
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


def main(slopes_path: str, truth_path: str) -> int:
    slopes, truth = (json.loads(Path(path).read_text(encoding="utf-8")) for path in (slopes_path, truth_path))
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
