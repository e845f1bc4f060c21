"""The planes of a scene whose motion is known: dense cells with inverse depths, labelled by plane."""

from __future__ import annotations

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.epipolar import homogeneous
from slopecli.patches.labelling.energy import Energy, by_size
from slopecli.patches.labelling.models import DepthModel
from slopecli.patches.labelling.neighbours import mutual_graph, nearest
from slopecli.patches.labelling.proposals import propose_surfaces
from slopecli.patches.labelling.search import State, make_pool, search, settled
from slopecli.types import FloatArray, IntArray

NEIGHBOURS = 6  # of every cell
SMOOTH = 1.0  # nats for two neighbours on different planes
PLANE = 40.0  # nats to state a plane: about ten cells that nothing else explains
SCALE_PX = (0.2, 1.0)  # px of image 2: no surface is matched as flatter, or counts as flat beyond
SEARCHED = 2500  # cells among which planes are sought; all are labelled in the end
SAMPLE = 1200  # cells on which proposals compete
AROUND = 24  # cells around a seed that propose a plane
LEAST_CELLS = 8  # fewer show no plane


def label_scene_planes(
    x1: FloatArray,
    w: FloatArray,
    leverage: FloatArray,
    uv1: FloatArray,
    focal_px: float,
    seed: int = 0,
    sigma_px: float | None = None,
) -> tuple[IntArray, FloatArray]:
    """Say which plane each cell is on, the motion being known: an unknown number of planes, and cells on none.

    Parameters
    ----------
    x1 : (n, 2) normalised points of image 1.  w : (n,) inverse depths, 1/baseline.
    leverage : (n,) image-2 motion per unit of inverse depth, normalised.  uv1 : (n, 2) px of image 1.
    focal_px : px of image 2 per unit of normalised coordinate.  seed : of the random draws.
    sigma_px : scale of a cell's distance in image 2 from its plane, px; None estimates it.

    Returns
    -------
    labels : (n,) int, 0..k-1, the plane with most cells first, -1 for none. One plane may be in several pieces.
    scaled_normals : (k, 3), N . (x1, 1) = w.

    Raises
    ------
    InputError : the arrays do not match or are not finite.
    """
    n = len(x1)
    shapes = [np.shape(x1), np.shape(w), np.shape(leverage), np.shape(uv1)]
    if shapes != [(n, 2), (n,), (n,), (n, 2)] or not np.isfinite(np.column_stack([x1, w, leverage, uv1])).all():
        raise InputError(f"x1, w, leverage, uv1 must be finite, (n, 2), (n,), (n,), (n, 2); found {shapes}")
    if n < LEAST_CELLS:
        return np.full(n, -1), np.empty((0, 3))
    px = leverage * focal_px
    bounds = SCALE_PX if sigma_px is None else (sigma_px, sigma_px)
    cells = DepthModel(homogeneous(x1) * px[:, None], w * px, np.zeros(n), bounds)
    rng = np.random.default_rng(seed)
    part = np.sort(rng.permutation(n)[:SEARCHED])
    found = _found(cells.take(part), uv1[part], rng)
    if n > len(part):
        graph = mutual_graph(nearest(uv1, NEIGHBOURS), SMOOTH)
        found = settled(cells, Energy(graph, _none(cells), PLANE), found.planes, found.scale)
    labels, order = by_size(found.labels, len(found.planes))
    return labels, found.planes[order]


def _none(cells: DepthModel) -> float:
    """The cost of a cell on no plane, nats: its depth may be any that the scene shows."""
    low, high = np.quantile(cells.target, [0.01, 0.99])
    return float(np.log(max(high - low, 10 * cells.bounds[0])))


def _found(cells: DepthModel, uv1: FloatArray, rng: np.random.Generator) -> State:
    near = nearest(uv1, AROUND)
    energy = Energy(mutual_graph(near[:, :NEIGHBOURS], SMOOTH), _none(cells), PLANE)
    proposals = propose_surfaces(cells.rows, cells.target, near, rng)
    pool = make_pool(cells, proposals, np.arange(len(proposals)), rng.permutation(len(uv1))[:SAMPLE], energy.none)
    return search(cells, energy, pool)
