"""The one epipolar geometry that all planes of a static scene share, from the planes found without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous, skew
from slopecli.patches.labelling.residual_cost import cost_of, scale_of, weight_of
from slopecli.types import BoolArray, FloatArray, IntArray

PLANES, PAIRS = 3, 150  # planes from which an epipole is sought, and pairs of other points tried with each
JUDGES = 500  # points by which the epipoles are judged
REFINED, STEPS = 5, 8  # best ones that are refined, and rounds of refining
LEAST = 9  # points: one more than fix a fundamental matrix linearly
OFF_PLANE = 2.0, 20.0  # scales of noise from a plane: from where a point shows parallax, and where it may be mismatched


@dataclass(frozen=True, eq=False)
class Epipolar:
    """F (3, 3), x2~^T F x1~ = 0, and the scale of the residuals across the epipolar lines, unit of the points."""

    F: FloatArray
    scale: float


@dataclass(frozen=True, eq=False)
class AlongLine:
    """Matches seen along their epipolar lines: w (n,) the projective depth x2~ ~ S x1~ + w e2, leverage (n,) the motion
    in image 2 per unit of w, across (n,) the cost, nats, of the residual across the line, and which obey it (n,)."""

    w: FloatArray
    leverage: FloatArray
    across: FloatArray
    obeys: BoolArray


def find_epipolar(
    x1: FloatArray,
    x2: FloatArray,
    homographies: FloatArray,
    squares: FloatArray,
    labels: IntArray,
    scale: float,
    bounds: tuple[float, float],
    none: float,
    rng: np.random.Generator,
) -> Epipolar | None:
    """The fundamental matrix that most points obey, from planes and the parallax of points off them.

    Source: plane and parallax (Hartley and Zisserman, algorithm 13.2): the lines joining H x1 and x2 of two points
    off the plane meet in the epipole.

    Parameters
    ----------
    x1, x2 : (n, 2) centred, of about unit size.  homographies : (k, 9).  squares : (n, k) their squared residuals.
    labels : (n,) 0 for none or 1..k.  scale, bounds : of the noise.  none : cost of a residual of no line, nats.

    Returns
    -------
    None where fewer than two points stand off every plane, or too few obey any epipolar geometry.
    """
    p, q = homogeneous(x1), homogeneous(x2)
    candidates = [
        _through_parallax(H.reshape(3, 3), p, q, _parallax_weight(squares[:, k], labels, k, scale), rng)
        for k, H in enumerate(homographies[:PLANES])
    ]
    F = np.concatenate([np.empty((0, 3, 3)), *candidates])
    if not len(F):
        return None
    judge = rng.permutation(len(p))[:JUDGES]
    cost = np.minimum(cost_of(_distance(F, p[judge], q[judge]) ** 2, scale, 1), none).sum(axis=1)
    refined = [_refined(F[i], p, q, scale, bounds, none) for i in np.argsort(cost, kind="stable")[:REFINED]]
    cost_and_answer = min(refined, key=lambda answer: answer[0])
    return cost_and_answer[1] if np.isfinite(cost_and_answer[0]) else None


def _parallax_weight(squares: FloatArray, labels: IntArray, k: int, scale: float) -> FloatArray:
    """(n,) how likely a point is a true match off plane k: on another plane, or off this one by not too much."""
    near, far = OFF_PLANE[0] * scale, OFF_PLANE[1] * scale
    weight = np.where(squares > near**2, 1.0 / (1.0 + squares / far**2), 0.0)
    return np.asarray(np.where((labels > 0) & (labels != k + 1), 1.0, weight))


def _through_parallax(
    H: FloatArray, p: FloatArray, q: FloatArray, weight: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """(c, 3, 3) fundamental matrices [e2]x H from pairs of points drawn by weight."""
    if np.count_nonzero(weight) < 2:
        return np.empty((0, 3, 3))
    pair = rng.choice(len(p), (PAIRS, 2), p=weight / weight.sum())
    line = np.cross(p @ H.T, q)
    epipole = np.cross(line[pair[:, 0]], line[pair[:, 1]])
    length = np.linalg.norm(epipole, axis=1)
    sharp = length > 1e-12 * np.linalg.norm(line, axis=1).max() ** 2
    return skew(epipole[sharp] / length[sharp, None]) @ H


def _distance(F: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
    """(..., n) Sampson's distance times sqrt 2, as if all error were in image 2; F (..., 3, 3), p, q (n, 3)."""
    line2, line1 = p @ np.swapaxes(F, -1, -2), q @ F
    square = (line2[..., :2] ** 2).sum(axis=-1) + (line1[..., :2] ** 2).sum(axis=-1)
    return np.asarray((line2 * q).sum(axis=-1) * np.sqrt(2.0 / np.maximum(square, 1e-30)))


def _refined(
    F: FloatArray, p: FloatArray, q: FloatArray, scale: float, bounds: tuple[float, float], none: float
) -> tuple[float, Epipolar]:
    """The best of a few rounds of robust refinement, with its cost."""
    best = np.inf, Epipolar(F, scale)
    for _ in range(STEPS):
        square = _distance(F, p, q) ** 2
        obeys = cost_of(square, scale, 1) < none
        if obeys.sum() < LEAST:
            break
        cost = float(np.minimum(cost_of(square, scale, 1), none).sum())
        best = min(best, (cost, Epipolar(F, scale)), key=lambda answer: answer[0])
        scale = scale_of(square[obeys], 1, scale, bounds)
        F = _reweighted(F, p[obeys], q[obeys], scale)
    return best


def refit_epipolar(
    epipolar: Epipolar, x1: FloatArray, x2: FloatArray, on: BoolArray, bounds: tuple[float, float]
) -> Epipolar:
    """The fundamental matrix fitted to the points on planes; as it is when they are too few."""
    p, q = homogeneous(x1[on]), homogeneous(x2[on])
    if len(p) < LEAST:
        return epipolar
    F, scale = epipolar.F, epipolar.scale
    for _ in range(STEPS):
        scale = scale_of(_distance(F, p, q) ** 2, 1, scale, bounds)
        F = _reweighted(F, p, q, scale)
    return Epipolar(F, scale_of(_distance(F, p, q) ** 2, 1, scale, bounds))


def _reweighted(F: FloatArray, p: FloatArray, q: FloatArray, scale: float) -> FloatArray:
    """One round of the eight-point algorithm with robust weights and Sampson's (Hartley and Zisserman, 11.4)."""
    line2, line1 = p @ F.T, q @ F
    square = (line2[:, :2] ** 2).sum(axis=1) + (line1[:, :2] ** 2).sum(axis=1)
    weight = weight_of(_distance(F, p, q) ** 2, scale, 1) / np.maximum(square, 1e-30)
    products = (q[:, :, None] * p[:, None, :]).reshape(-1, 9)
    moments = (products * weight[:, None]).T @ products
    fresh = np.linalg.eigh(moments)[1][:, 0].reshape(3, 3)
    u, s, vt = np.linalg.svd(fresh)
    return np.asarray((u * [s[0], s[1], 0.0]) @ vt)


def along_lines(epipolar: Epipolar, x1: FloatArray, x2: FloatArray, none: float) -> AlongLine:
    """What the matches (n, 2) tell of depth under an epipolar geometry; none: cost of obeying no line, nats.

    Source: x2~ ~ S x1~ + w e2 with S = [e2]x F (Hartley and Zisserman, result 9.13), and w linear in (x1, 1) on a
    plane. A match on the wrong side of the epipole is of a point behind one camera and obeys nothing.
    """
    p, q = homogeneous(x1), homogeneous(x2)
    e2 = np.linalg.svd(epipolar.F)[0][:, 2]
    u = p @ (skew(e2) @ epipolar.F).T
    across_u, across_e = np.cross(q, u), np.cross(q, e2)
    w = -(across_u * across_e).sum(axis=1) / np.maximum((across_e**2).sum(axis=1), 1e-20)
    depth = np.abs(u[:, 2] + w * e2[2])
    leverage = np.linalg.norm(e2[:2] - x2 * e2[2], axis=1) / np.maximum(depth, 1e-12)
    across = cost_of(_distance(epipolar.F, p, q) ** 2, epipolar.scale, 1)
    side = np.sign((np.cross(e2, q) * (p @ epipolar.F.T)).sum(axis=1))
    obeys = across < none
    front = side == (1.0 if side[obeys].sum() >= 0 else -1.0)
    return AlongLine(w, leverage, np.where(front, across, 2 * none), obeys & front)
