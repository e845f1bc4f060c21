"""Planes found in pairs with known truth: regions of the image, planes of labelled correspondences, plane homographies.

    python benchmarks/planes.py [--only TEXT] [--into docs/accuracy.md]

The pairs lie below SLOPEMAP_DATA. A true plane of more than 1 % of the image is found if one region covers 30 % of it;
then the angle between the normals counts. Labelled correspondences (`*_matches.csv`: x1, y1, x2, y2, label, 0 for an
outlier) count as misclassified under the best assignment of planes, outliers being a class of their own. Where a pair
has plane homographies and no intrinsics, a camera is made up and the distance between transferred pixels counts.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from documents import write_between
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from slopecli.errors import NoAnswer
from slopecli.io import load_image
from slopecli.options import Options
from slopecli.patches import label_planes
from slopecli.pipeline import estimate
from slopecli.types import Camera, Plane, Report

MIN_AREA, MIN_VISIBLE = 0.01, 0.006  # shares of image 1 of true planes that count, and of them in image 2
MIN_COVERED = 0.3  # of a true plane by one region
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Segmented:
    """Result of one pair.

    errors_deg : of the normals of the true planes found.  missing : true planes not found.  n_planes : reported.
    sure_and_wrong : planes found with status ok and an error beyond 1 deg and four sigmas.
    unexplained : share of image 1 on no plane.  seconds : of processor time.
    """

    name: str
    errors_deg: list[float]
    missing: int
    sure_and_wrong: int
    n_planes: int
    unexplained: float
    seconds: float


def segmented(path: Path) -> Segmented:
    """Return the planes of one pair compared with its truth file."""
    truth = json.loads(path.read_text(encoding="utf-8"))
    images = [load_image(path.parent / truth[f"image{k}"]) for k in (1, 2)]
    cameras = [camera_of(truth, k, image.width, image.height) for k, image in enumerate(images, 1)]
    planes = list(true_planes(path, truth, images[0].grey.shape))
    start = time.process_time()
    try:
        report = estimate(*images, *cameras, Options(planes="regions", up="dominant-plane"))
    except NoAnswer:
        return Segmented(path.parent.name, [], len(planes), 0, 0, 1.0, 0.0)
    seconds = time.process_time() - start
    compared = [pair for mask, normal in planes for pair in _compared(report, mask, normal)]
    found = [error for error, _ in compared]
    wrong = sum(ours.status == "ok" and error > 1 + 4 * (ours.slope_sigma_deg or 0.0) for error, ours in compared)
    unexplained = float((report.labels == 0).mean())
    name = path.parent.name if path.name == "truth.json" else path.name.removesuffix(".truth.json")
    return Segmented(name, found, len(planes) - len(found), wrong, len(report.planes), unexplained, seconds)


def _compared(report: Report, mask: Mask, normal: NDArray[np.float64]) -> Iterator[tuple[float, Plane]]:
    """Yield the angle between a true normal and that of the plane found there, deg, and that plane, if there is one."""
    best = covering(report.labels, mask)
    if best is not None:
        ours = next(plane for plane in report.planes if plane.id == best)
        cosine = abs(float(ours.normal_cam1 @ normal)) / float(np.linalg.norm(normal))
        yield float(np.degrees(np.arccos(np.clip(cosine, 0, 1)))), ours


def covering(labels: NDArray[np.uint16], mask: Mask) -> int | None:
    """Return the id of the region that covers most of a mask; None if it covers less than MIN_COVERED of it."""
    ids, counts = np.unique(labels[mask], return_counts=True)
    counts[ids == 0] = 0
    return int(ids[counts.argmax()]) if counts.max(initial=0) >= MIN_COVERED * mask.sum() else None


def camera_of(truth: dict[str, Any], k: int, width: int, height: int) -> Camera:
    """Return the camera of image k of a truth file, one made up where it has none."""
    K = truth.get("K") or truth.get(f"K{k}")
    distortion = tuple(truth.get("dist") or truth.get(f"dist{k}") or ())
    if K is None:
        return Camera(width, height, width, width, (width - 1) / 2, (height - 1) / 2)
    numbers = K[0][0], K[1][1], K[0][2], K[1][2]
    return Camera(
        width, height, *numbers, "brown" if any(distortion) else "pinhole", distortion if any(distortion) else ()
    )


def true_planes(
    path: Path, truth: dict[str, Any], shape: tuple[int, int]
) -> Iterator[tuple[Mask, NDArray[np.float64]]]:
    """Yield the pixels (h, w) and the normal (3,) of every true plane that counts."""
    for plane in truth.get("planes", []):
        if plane.get("n") is None or not plane.get("trusted", True):
            continue
        mask = true_mask(path, truth, plane, shape)
        visible = plane.get("visible_pixels", mask.size)
        if mask.sum() >= MIN_AREA * mask.size and visible >= MIN_VISIBLE * mask.size:
            yield mask, np.array(plane["n"], float)


def true_mask(path: Path, truth: dict[str, Any], plane: dict[str, Any], shape: tuple[int, int]) -> Mask:
    """Pixels (h, w) of a true plane."""
    if "polygon" in plane:
        canvas = np.zeros(shape, np.uint8)
        cv2.fillPoly(canvas, [np.round(plane["polygon"]).astype(np.int32)], 1)
        return canvas > 0
    labels = cv2.imread(str(path.parent / (plane.get("mask") or truth["labels"])), cv2.IMREAD_UNCHANGED)
    return np.asarray(labels == plane.get("label", plane.get("id")))


def transfer_errors_px(path: Path, planes: str = "regions") -> list[float]:
    """Return, for every true homography, the median distance, px, between its image of common pixels and ours."""
    truth = json.loads(path.read_text(encoding="utf-8"))
    images = [load_image(path.parent / truth[f"image{k}"]) for k in (1, 2)]
    cameras = [camera_of(truth, k, image.width, image.height) for k, image in enumerate(images, 1)]
    report = estimate(*images, *cameras, Options(planes=planes, up="dominant-plane"))  # type: ignore[arg-type]
    errors = []
    for plane in truth["planes"]:
        mask = true_mask(path, truth, plane, images[0].grey.shape)
        best = covering(report.labels, mask)
        if best is None:
            errors.append(float("inf"))
            continue
        ours = next(p.homography_px for p in report.planes if p.id == best)
        rows, columns = np.nonzero(mask & (report.labels == best))
        pixels = np.stack([columns, rows, np.ones(len(rows))])
        sent = [(H @ pixels)[:2] / (H @ pixels)[2] for H in (np.array(plane.get("H") or plane["H_lsq"]), ours)]
        errors.append(float(np.median(np.linalg.norm(sent[0] - sent[1], axis=0))))
    return errors


def misclassified(path: Path, seed: int = 0) -> tuple[float, float, int]:
    """Share of labelled correspondences with the wrong label, seconds of processor time, and how many there are."""
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))[1:]
    table = np.array(rows, float)
    truth = table[:, 4].astype(int)
    start = time.process_time()
    labels = label_planes(table[:, :2], table[:, 2:4], seed=seed)
    seconds = time.process_time() - start
    named, found = [k for k in np.unique(truth) if k > 0], [k for k in np.unique(labels) if k >= 0]
    agree = np.array([[np.sum((truth == a) & (labels == b)) for b in found] for a in named]).reshape(
        len(named), len(found)
    )
    right = agree[linear_sum_assignment(-agree)].sum() + np.sum((truth == 0) & (labels == -1))
    return 1 - float(right) / len(truth), seconds, len(truth)


def tables(data: Path, only: str) -> Iterator[str]:
    """The measurements as Markdown."""
    yield from _regions(data, only)
    files = [path for path in sorted(data.glob("**/*_matches.csv")) if only in str(path)]
    if files:
        yield "\n| correspondences | pairs | misclassified: mean | median | worst | s of processor time: worst |"
        yield "|---|---|---|---|---|---|"
        found = [misclassified(path) for path in files]
        wrong, seconds = np.array([f[0] for f in found]), max(f[1] for f in found)
        shares = " | ".join(f"{100 * value:.1f} %" for value in (wrong.mean(), np.median(wrong), wrong.max()))
        yield f"| {files[0].parent.name} | {len(found)} | {shares} | {seconds:.1f} |"
    files = [path for path in sorted(data.glob("**/*-planar/*.truth.json")) if only in str(path)]
    if files:
        errors = np.array([error for path in files for error in transfer_errors_px(path)])
        yield "\n| plane homographies | planes | found | transfer error: median, px | worst found, px |"
        yield "|---|---|---|---|---|"
        known = errors[np.isfinite(errors)]
        yield f"| {files[0].parent.name} | {len(errors)} | {len(known)} | {np.median(known):.2f} | {known.max():.2f} |"


def _regions(data: Path, only: str) -> Iterator[str]:
    yield "| regions | true planes | found | median, deg | within 5 deg | sure and wrong | s of processor time a pair |"
    yield "|---|---|---|---|---|---|---|"
    for name, paths in _sets(data, only).items():
        found = [segmented(path) for path in paths]
        errors = np.array([error for one in found for error in one.errors_deg])
        total = len(errors) + sum(one.missing for one in found)
        wrong, seconds = sum(one.sure_and_wrong for one in found), np.median([one.seconds for one in found])
        yield (
            f"| {name} | {total} | {100 * len(errors) / max(total, 1):.0f} % | {np.median(errors):.2f} | "
            f"{100 * np.mean(errors < 5):.0f} % | {wrong} | {seconds:.1f} |"
        )


def _sets(data: Path, only: str) -> dict[str, list[Path]]:
    """Truth files of the urban sets."""
    sets = {"rendered C": sorted(data.glob("rendered/C*/truth.json"))}
    for name in ("middlebury-2014-trainingQ", "strecha", "sceaux-castle", "lund-door"):
        sets[name] = sorted(data.glob(f"real/{name}/*.truth.json"))
    chosen = {name: [path for path in paths if only in str(path)] for name, paths in sets.items()}
    return {name: paths for name, paths in chosen.items() if paths}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="TEXT")
    parser.add_argument("--into", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    if "SLOPEMAP_DATA" not in os.environ:
        sys.exit("SLOPEMAP_DATA names no folder of image pairs")
    lines = []
    for line in tables(Path(os.environ["SLOPEMAP_DATA"]), arguments.only):
        print(line, flush=True)
        lines.append(line)
    if arguments.into:
        write_between(arguments.into, "planes", "\n".join(lines))


if __name__ == "__main__":
    main()
