"""Files of a sequence: its line a frame, its trajectory, and slopes.json with the motions of all frames."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from slopecli.products import geojson
from slopecli.products.origin import Origin
from slopecli.products.page import report_page
from slopecli.products.slopes_json import map_keys, plain, report_document, to_json
from slopecli.sequence.frame import SequenceAnswer, SequenceStep
from slopecli.types import FloatArray, Image


def encode_sequence(answer: SequenceAnswer, image: Image) -> bytes:
    """Return the content of slopes.json of a sequence: that of its report, and the key "motions"."""
    return (sequence_to_json(answer) + "\n").encode("ascii")


def sequence_to_json(answer: SequenceAnswer) -> str:
    """Serialise the answer of a sequence as `report_to_json` does a report."""
    of_map = {} if answer.map is None else map_keys(answer.map)
    return to_json({**report_document(answer.report), **of_map, "motions": answer.motions})


def encode_places(answer: SequenceAnswer, image: Image) -> bytes:
    """slopes.geojson of the last state, with the landing sites of its map."""
    return geojson.encode(answer.report, image) if answer.map is None else geojson.encode_map(answer.map, image)


def encode_page(answer: SequenceAnswer, image: Image, origin: Origin | None = None) -> bytes:
    """report.html of the last state: that of its map, where there is one."""
    if answer.map is not None:
        return report_page.encode_map(answer.map, image, origin)
    return report_page.encode(answer.report, image, origin)


def encode_trajectory(answer: SequenceAnswer, image: Image) -> bytes:
    """Return trajectory.txt in TUM format: time, position, orientation as a quaternion x y z w, a line a frame.

    Camera to world, the world being the axes of the first camera; frames whose time is not known have their number.
    """
    lines = [
        "# time_s tx ty tz qx qy qz qw; "
        + f"lengths in {'metres' if answer.report.scale.unit == 'm' else 'baselines of the first move'}"
    ]
    for one in answer.motions:
        time = one.frame if one.time_s is None else one.time_s
        x, y, z = one.motion.baseline_cam1.tolist()
        quaternion = " ".join(f"{value:.9g}" for value in _quaternion(one.motion.rotation_cam2_from_cam1.T))
        lines.append(f"{time:.9g} {x:.9g} {y:.9g} {z:.9g} {quaternion}")
    return ("\n".join(lines) + "\n").encode("ascii")


def _quaternion(R: FloatArray) -> list[float]:
    """x, y, z, w of a rotation (3, 3), w not negative: the largest eigenvector of Bar-Itzhack's matrix (2000)."""
    m = R
    K = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], 0.0, 0.0, 0.0],
            [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], 0.0, 0.0],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], 0.0],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], m[0, 0] + m[1, 1] + m[2, 2]],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    q = q if q[3] >= 0.0 else -q
    return [float(value) + 0.0 for value in q]


def frame_line(step: SequenceStep) -> bytes:
    """The object of one frame for sequence.jsonl, without the end of the line."""
    state, report = step.state, step.report
    document: dict[str, Any] = {
        "frame": state.frame,
        "image": state.image,
        "time_s": state.time_s,
        "status": state.status,
        "motion": step.motion,
        "planes": [],
        "ambiguity": None,
        "settled": [{"id": number, "verdict": verdict} for number, verdict in sorted(step.settled.items())],
        "diagnostics": [],
    }
    if state.why is not None:
        document["diagnostics"] = [
            {
                "code": "frame-skipped",
                "severity": "info",
                "message": f"{state.why.code}: {state.why.message}",
                "value": None,
                "remedy": None,
            }
        ]
    if report is not None:
        document["planes"] = [_short(plain(plane)) for plane in report.planes]
        document["ambiguity"] = {"status": report.ambiguity.status, "delta_chi2": report.ambiguity.delta_chi2}
        document["diagnostics"] = report.diagnostics
    return json.dumps(plain(document), allow_nan=False, separators=(",", ":")).encode("ascii")


def _short(plane: dict[str, Any]) -> dict[str, Any]:
    """A plane without what stays the same from frame to frame."""
    return {name: value for name, value in plane.items() if name not in ("polygon_px", "homography_px", "source")}
