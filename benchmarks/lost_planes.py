"""Which stage of `segment` lost every true plane that it does not find: one line a plane, and a count of the stages.

    SLOPEMAP_DATA=FOLDER python benchmarks/lost_planes.py [--only TEXT]

A true plane of more than 1 % of image 1 is found if one region covers 30 % of it and its normal is within 5 degrees.
The stages, in order: *no evidence* (few of its cells are matched), *wrong matches* (most of these are on no plane of
its orientation), *not proposed*, *not chosen*, *merged* (into another plane), *labelling*, *refused* (its matches do
not determine the slope), *wrong* (answered, more than 5 degrees off).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from planes import Mask, camera_of, covering, true_planes

from slopecli.errors import NoAnswer
from slopecli.geometry import GATE_SIGMAS, normal_angle
from slopecli.io import load_image
from slopecli.look import find_scene
from slopecli.options import Options
from slopecli.patches.regions import REGION, CellLattice, Piece, RegionStages, region_stages
from slopecli.pipeline import estimate
from slopecli.types import Report

FOUND, LIKE_DEG, RIGHT_DEG = 0.3, 10.0, 5.0  # share of a plane covered; angle of a proposal, and of an answer, to it
MATCHED, ON_PLANE = 0.25, 0.5  # share of its cells with a match, and of these on a plane of its orientation
SETS = ("rendered/C*/truth.json", "real/*/*.truth.json")


def stages_of(path: Path, truth: dict[str, Any]) -> tuple[RegionStages, Report]:
    """Return what each stage made of a pair, and the answer."""
    images = [load_image(path.parent / truth[f"image{k}"]) for k in (1, 2)]
    cameras = [camera_of(truth, k, image.width, image.height) for k, image in enumerate(images, 1)]
    options = Options(planes="regions", up="camera")
    greys = [image.grey for image in images]
    scene, _ = find_scene(*greys, *cameras, options, [], check_sparse=lambda *counts: None)
    return region_stages(scene, options), estimate(*images, *cameras, options)


def lost_by(stages: RegionStages, report: Report, mask: Mask, normal: NDArray[np.float64]) -> str:
    """Return the stage that lost a true plane, "found" if none did; mask (h, w) px of image 1, normal (3,)."""
    best = covering(report.labels, mask)
    if best is not None:
        ours = next(plane.normal_cam1 for plane in report.planes if plane.id == best)
        return "found" if _angle_deg(ours, normal) <= RIGHT_DEG else "wrong"
    lattice = stages.lattice
    cells = _cells_of(mask, stages.labels.shape, lattice.shape)
    if (cells & lattice.known).sum() < MATCHED * cells.sum():
        return "no evidence"
    if _share_on_plane(lattice, cells, normal) < ON_PLANE:
        return "wrong matches"
    for name, pieces in (("not proposed", stages.proposed), ("not chosen", stages.chosen), ("merged", stages.merged)):
        if not _holds(pieces, cells & lattice.known, normal):
            return name
    at = cv2.resize(mask.astype(np.uint8), stages.labels.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    return "labelling" if covering(stages.labels.astype(np.uint16), at) is None else "refused"


def _cells_of(mask: Mask, working: tuple[int, ...], shape: tuple[int, int]) -> Mask:
    """Return the cells (h, w) of which the mask covers more than half."""
    share = cv2.resize(mask.astype(np.float32), working[::-1], interpolation=cv2.INTER_AREA)
    height, width = (n * REGION.cell_px for n in shape)
    return np.asarray(cv2.resize(share[:height, :width], shape[::-1], interpolation=cv2.INTER_AREA) > 0.5)


def _share_on_plane(lattice: CellLattice, cells: Mask, normal: NDArray[np.float64]) -> float:
    """Return the share of known cells that lie on the best plane of an orientation, relief allowed for."""
    own = cells & lattice.known
    along = lattice.rows[own] @ normal
    distance = np.median(lattice.target[own] / np.where(np.abs(along) < 1e-9, np.nan, along))
    off = np.abs(along * distance - lattice.target[own])
    return float((off < GATE_SIGMAS * max(REGION.tolerances)).mean())


def _holds(pieces: Sequence[Piece], known: Mask, normal: NDArray[np.float64]) -> bool:
    """Return whether a piece of about this orientation covers enough of the known cells."""
    return any(
        (piece.cells & known).sum() >= FOUND * known.sum() and _angle_deg(piece.plane, normal) <= LIKE_DEG
        for piece in pieces
    )


def _angle_deg(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    angle = float(np.degrees(normal_angle(one, other)))
    return min(angle, 180.0 - angle)


def lines(data: Path, only: str) -> Iterator[str]:
    """The planes that were lost, then a count of the stages, as Markdown."""
    yield "| pair | plane | of the image | lost by |"
    yield "|---|---|---|---|"
    count: Counter[str] = Counter()
    for path in sorted(path for pattern in SETS for path in data.glob(pattern) if only in str(path)):
        truth = json.loads(path.read_text(encoding="utf-8"))
        if "K" not in truth and "K1" not in truth:
            continue
        image = load_image(path.parent / truth["image1"])
        planes = list(true_planes(path, truth, image.grey.shape))
        try:
            stages, report = stages_of(path, truth) if planes else (None, None)
        except NoAnswer:
            count["no answer"] += len(planes)
            continue
        for number, (mask, normal) in enumerate(planes, 1):
            assert stages is not None
            assert report is not None
            stage = lost_by(stages, report, mask, normal)
            count[stage] += 1
            if stage != "found":
                name = path.parent.name if path.name == "truth.json" else path.name.removesuffix(".truth.json")
                yield f"| {name} | {number} | {100 * mask.mean():.1f} % | {stage} |"
    yield "\n" + ", ".join(f"{stage}: {n}" for stage, n in count.most_common())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="TEXT")
    arguments = parser.parse_args()
    if "SLOPEMAP_DATA" not in os.environ:
        sys.exit("SLOPEMAP_DATA names no folder of image pairs")
    for line in lines(Path(os.environ["SLOPEMAP_DATA"]), arguments.only):
        print(line, flush=True)


if __name__ == "__main__":
    main()
