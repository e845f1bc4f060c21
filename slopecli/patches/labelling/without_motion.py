"""Correspondences labelled by plane, with nothing known of the cameras: proposals from neighbours, one energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.epipolar import homogeneous
from slopecli.patches.labelling.energy import Energy, Graph, by_size
from slopecli.patches.labelling.models import DepthModel, HomographyModel
from slopecli.patches.labelling.neighbours import mutual_graph
from slopecli.patches.labelling.proposals import (
    CIRCLES,
    conditioner,
    nearest_in_both,
    propose_depth_planes,
    propose_homographies,
)
from slopecli.patches.labelling.search import State, make_pool, search, settled
from slopecli.patches.labelling.shared_epipolar import Epipolar, along_lines, find_epipolar, refit_epipolar
from slopecli.types import BoolArray, FloatArray, IntArray

LEAST_POINTS = 5  # four fix a homography and leave nothing to check it
NEIGHBOURS = 6  # of every point, by distance in both images
SMOOTH = 0.5  # nats for two neighbours on different planes
PLANE, FREEDOM = 40.0, 5.0  # nats to state that there is a plane, and for every degree of freedom to say which
FLOOR_PX = 0.1  # smallest scale of noise believed: nobody matches better
CEILING = 0.01  # largest, of the diagonal of what image 2 shows: beyond that a surface is no plane
SEARCHED = 500  # matches among which planes are sought; all are labelled in the end
EPIPOLAR_ROUNDS = 2  # of fitting planes and epipolar geometry in turn


@dataclass(frozen=True, eq=False)
class _Matches:
    """x1, x2 (n, 2) different matches, centred and of about unit size; near (n, m) neighbours.

    none: cost of a match on no plane, nats: it may end anywhere in image 2.
    """

    x1: FloatArray
    x2: FloatArray
    near: IntArray
    none: float
    bounds: tuple[float, float]


def label_planes(uv1: FloatArray, uv2: FloatArray, seed: int = 0, sigma_px: float | None = None) -> IntArray:
    """Say which plane each correspondence of two images lies on: an unknown number of planes, and mismatches.

    Planes are proposed from neighbours and chosen, all together, by one energy (see `labelling`). Those found give the
    epipolar geometry they share. Under it a plane has three degrees of freedom left, and what stands off it (window
    bays, mouldings) does so along the epipolar lines. The answer under it is taken if its energy is lower, so that
    a moving object or a bent lens does not spoil it.

    Parameters
    ----------
    uv1, uv2 : (n, 2) px of images 1 and 2. The same match given twice counts once and gets one label.
    seed : of the random draws; the same seed gives the same labels, in whatever order the matches come.
    sigma_px : scale of the noise in image 2, px; None estimates it from the matches.

    Returns
    -------
    labels : (n,) int, 0..k-1, the plane with most correspondences first; -1 for one on no plane.

    Raises
    ------
    InputError : the arrays are not finite and of one shape (n, 2), or sigma_px is not positive.
    """
    uv1, uv2 = _checked(uv1, uv2, sigma_px)
    matches, place = np.unique(np.hstack([uv1, uv2]), axis=0, return_inverse=True)
    if len(matches) < LEAST_POINTS or not np.ptp(matches, axis=0).all():
        return np.full(len(uv1), -1)
    labels = _label(_prepare(matches[:, :2], matches[:, 2:], sigma_px), np.random.default_rng(seed))
    return by_size(labels[place.ravel()], int(labels.max(initial=0)))[0]


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


def _prepare(uv1: FloatArray, uv2: FloatArray, sigma_px: float | None) -> _Matches:
    (centre1, size1), (centre2, size2) = conditioner(uv1), conditioner(uv2)
    x1, x2 = (uv1 - centre1) / size1, (uv2 - centre2) / size2
    width, height = np.ptp(x2, axis=0)
    ceiling = CEILING * float(np.hypot(width, height))
    floor = FLOOR_PX / size2
    bounds = (floor, max(ceiling, floor)) if sigma_px is None else (sigma_px / size2, sigma_px / size2)
    near = nearest_in_both(x1, x2, CIRCLES[-1][0])
    return _Matches(x1, x2, near, float(np.log(width * height)), bounds)


def _label(matches: _Matches, rng: np.random.Generator) -> IntArray:
    """Labels (n,) 0 for none: planes sought among some of the matches, then all of them labelled."""
    part = _some(matches, rng)
    state, epipolar = _sought(part, rng)
    if part is matches:
        return state.labels
    if not len(state.planes):
        return np.zeros(len(matches.x1), np.int64)
    graph = mutual_graph(matches.near[:, :NEIGHBOURS], SMOOTH)
    if epipolar is None:
        free = HomographyModel(matches.x1, matches.x2, matches.bounds)
        return settled(free, _free_energy(graph, matches), state.planes, state.scale).labels
    bound, _ = _depth_model(matches, epipolar)
    return settled(bound, _bound_energy(graph, matches), state.planes, state.scale).labels


def _some(matches: _Matches, rng: np.random.Generator) -> _Matches:
    """Matches enough to seek planes among, evenly drawn; the same object when there are no more."""
    if len(matches.x1) <= SEARCHED:
        return matches
    part = np.sort(rng.permutation(len(matches.x1))[:SEARCHED])
    x1, x2 = matches.x1[part], matches.x2[part]
    return _Matches(x1, x2, nearest_in_both(x1, x2, CIRCLES[-1][0]), matches.none, matches.bounds)


def _sought(matches: _Matches, rng: np.random.Generator) -> tuple[State, Epipolar | None]:
    """The planes, and the epipolar geometry they share if it pays."""
    graph = mutual_graph(matches.near[:, :NEIGHBOURS], SMOOTH)
    free, model = _free_planes(matches, graph, rng)
    if not len(free.planes):
        return free, None
    line = 0.5 * matches.none
    epipolar = find_epipolar(
        matches.x1, matches.x2, free.planes, model.squares(free.planes), free.labels, free.scale,
        matches.bounds, line, rng,
    )  # fmt: skip
    if epipolar is None:
        return free, None
    bound, epipolar = _bound_planes(matches, graph, epipolar, free, rng)
    return (bound, epipolar) if bound.energy + 7 * FREEDOM < free.energy else (free, None)


def _free_energy(graph: Graph, matches: _Matches) -> Energy:
    return Energy(graph, matches.none, PLANE + 8 * FREEDOM)


def _bound_energy(graph: Graph, matches: _Matches) -> Energy:
    return Energy(graph, matches.none, PLANE + 3 * FREEDOM)


def _free_planes(matches: _Matches, graph: Graph, rng: np.random.Generator) -> tuple[State, HomographyModel]:
    """Planes as homographies that have nothing to do with each other."""
    model = HomographyModel(matches.x1, matches.x2, matches.bounds)
    energy = _free_energy(graph, matches)
    proposals = propose_homographies(matches.x1, matches.x2, matches.near, rng)
    sample = rng.permutation(len(matches.x1))
    return search(model, energy, make_pool(model, *proposals, sample, matches.none)), model


def _bound_planes(
    matches: _Matches, graph: Graph, epipolar: Epipolar, free: State, rng: np.random.Generator
) -> tuple[State, Epipolar]:
    """Planes that share an epipolar geometry, which is fitted to them in turn."""
    energy = _bound_energy(graph, matches)
    model, usable = _depth_model(matches, epipolar)
    proposals = propose_depth_planes(model.rows, model.target, matches.near, usable, rng)
    sample = rng.permutation(len(matches.x1))
    pool = make_pool(model, *proposals, sample, matches.none)
    state = search(model, energy, pool, model.through(free.labels, free.scale))
    for _ in range(EPIPOLAR_ROUNDS):
        epipolar = refit_epipolar(epipolar, matches.x1, matches.x2, state.labels > 0, matches.bounds)
        model, _ = _depth_model(matches, epipolar)
        state = settled(model, energy, model.through(state.labels, state.scale), state.scale)
    return state, epipolar


def _depth_model(matches: _Matches, epipolar: Epipolar) -> tuple[DepthModel, BoolArray]:
    """Planes under an epipolar geometry, and which matches obey it."""
    line = along_lines(epipolar, matches.x1, matches.x2, 0.5 * matches.none)
    rows = homogeneous(matches.x1) * line.leverage[:, None]
    return DepthModel(rows, line.w * line.leverage, line.across, matches.bounds), line.obeys
