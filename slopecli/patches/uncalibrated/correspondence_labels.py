"""Correspondences labelled by plane, cameras and motion being unknown: proposals from neighbours, one energy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slopecli.errors import InputError
from slopecli.look.gradient_components import renumbered_by_size
from slopecli.look.noise import OVERVIEW_CELL_PX
from slopecli.patches.labelling.energy import Energy, neighbour_costs
from slopecli.patches.labelling.labelling_tunables import LABELLING
from slopecli.patches.labelling.search import make_pool, search, settled
from slopecli.patches.neighbours import nearest
from slopecli.patches.uncalibrated.homography_planes import HomographyPlanes, propose_homographies
from slopecli.types import FloatArray, IntArray


def label_planes(uv1: FloatArray, uv2: FloatArray, seed: int = 0, sigma_px: float | None = None) -> IntArray:
    """Find the plane each correspondence lies on, for an unknown number of planes, and the mismatches.

    Planes are independent homographies, proposed from neighbours and chosen together by one energy (see
    `labelling.energy`). No camera and no common motion is assumed.

    Parameters
    ----------
    uv1, uv2 : (n, 2) px of images 1 and 2. The same match given twice counts once and gets one label.
    seed : of the random draws; the same seed gives the same labels, in whatever order the matches come.
    sigma_px : scale of the residuals in image 2, px; None estimates it from the matches.

    Returns
    -------
    labels : (n,) int, 0..k-1, the plane with most correspondences first; -1 for one on no plane.

    Raises
    ------
    InputError : the arrays are not finite and of one shape (n, 2), or sigma_px is not positive.
    """
    uv1, uv2 = _checked(uv1, uv2, sigma_px)
    matches, place = np.unique(np.hstack([uv1, uv2]), axis=0, return_inverse=True)
    if len(matches) < 5 or not np.ptp(matches, axis=0).all():  # four fix a homography and leave nothing to check it
        return np.full(len(uv1), -1)
    labels = _label(_prepare(matches[:, :2], matches[:, 2:], sigma_px), np.random.default_rng(seed))
    return np.asarray(renumbered_by_size(labels[place.ravel()])[0], np.int64) - 1


def _checked(uv1: FloatArray, uv2: FloatArray, sigma_px: float | None) -> tuple[FloatArray, FloatArray]:
    uv1, uv2 = np.asarray(uv1, float), np.asarray(uv2, float)
    if uv1.shape != uv2.shape or uv1.ndim != 2 or uv1.shape[1] != 2:
        raise InputError(f"uv1 {uv1.shape} and uv2 {uv2.shape} must be of the same shape (n, 2): a row for each match")
    bad = np.flatnonzero(~np.isfinite(np.hstack([uv1, uv2])).all(axis=1))
    if len(bad):
        raise InputError(f"{len(bad)} of {len(uv1)} matches are not finite, the first in row {bad[0]}; leave them out")
    if sigma_px is not None and not sigma_px > 0:
        raise InputError(f"sigma_px is {sigma_px}, it must be positive, or None to estimate it")
    return uv1, uv2


@dataclass(frozen=True, eq=False)
class _Matches:
    """Different matches x1, x2 (n, 2), centred and of about unit size.

    none : cost of a match on no plane, nats: it may end anywhere in image 2.  bounds : of the residuals' scale.
    """

    x1: FloatArray
    x2: FloatArray
    none: float
    bounds: tuple[float, float]

    @cached_property
    def near(self) -> IntArray:
        """Nearest other matches (n, m), by distance in both images together: mismatches have hardly any near ones."""
        return nearest(np.hstack([self.x1, self.x2]), 1 + LABELLING.around)[:, 1:]

    @property
    def energy(self) -> Energy:
        """Energy of labels of all of them."""
        graph = neighbour_costs(self.near[:, : LABELLING.neighbours], LABELLING.smooth)
        return Energy(graph, self.none, 2.0 * LABELLING.plane)

    @property
    def model(self) -> HomographyPlanes:
        """Planes as homographies of them."""
        return HomographyPlanes(self.x1, self.x2, self.bounds)

    def some(self, count: int, rng: np.random.Generator) -> _Matches:
        """At most `count` of them, drawn at random."""
        if len(self.x1) <= count:
            return self
        part = np.sort(rng.permutation(len(self.x1))[:count])
        return _Matches(self.x1[part], self.x2[part], self.none, self.bounds)


def _prepare(uv1: FloatArray, uv2: FloatArray, sigma_px: float | None) -> _Matches:
    (x1, _), (x2, size2) = _conditioned(uv1), _conditioned(uv2)
    width, height = np.ptp(x2, axis=0)
    floor, ceiling = OVERVIEW_CELL_PX / size2, LABELLING.ceiling * float(np.hypot(width, height))
    bounds = (floor, max(ceiling, floor)) if sigma_px is None else (sigma_px / size2, sigma_px / size2)
    return _Matches(x1, x2, float(np.log(width * height)), bounds)


def _conditioned(uv: FloatArray) -> tuple[FloatArray, float]:
    """Return points moved to the origin and divided by a size, so that their mean distance is sqrt 2, and that size."""
    centred = uv - uv.mean(axis=0)
    size = float(np.linalg.norm(centred, axis=1).mean() / np.sqrt(2.0))
    return centred / size, size


def _label(matches: _Matches, rng: np.random.Generator) -> IntArray:
    """Return labels (n,) 0 for none: planes are sought among some of the matches, then all are labelled."""
    part = matches.some(LABELLING.points, rng)
    model = part.model
    planes, place = propose_homographies(part.x1, part.x2, part.near, rng)
    found = search(model, part.energy, make_pool(model, planes, place, np.arange(len(part.x1)), part.none))
    if part is matches or not len(found.planes):
        return found.labels if part is matches else np.zeros(len(matches.x1), np.int64)
    return settled(matches.model, matches.energy, found.planes, found.scale).labels
