"""Why the sigma of a slope is what it is: its parts by cause, whose squares add up to its square."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.slope import slope_sigmas, surface_normals, tilt_parts
from slopecli.geometry.solver.relief import plane_variances
from slopecli.measure import Measured, borrowed_sigma_rad, surer_tilts
from slopecli.patches.join import Joined
from slopecli.types import FloatArray

# noise of the matches; height of the ground off its plane; parts of a patch without matches; the motion between the
# images; what is level; the focal length
CAUSES = ("matches", "relief", "gaps", "motion", "up", "camera")


def sigma_causes(root: Measured, joined: Joined) -> list[dict[str, float] | None]:
    """Parts of the 1-sigma of every slope by cause, deg; None for the plane taken as level.

    A slope is the length of a tilt, which errs along the slope and, where it is level, across it as well. An error
    across counts here by the share that brings the parts to the stated sigma.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        squares = _squares(root, joined)
    degrees = np.degrees(np.sqrt(np.nan_to_num(np.maximum(squares, 0.0))))
    return [None if k == root.level else dict(zip(CAUSES, row, strict=True)) for k, row in enumerate(degrees.tolist())]


def _squares(root: Measured, joined: Joined) -> FloatArray:
    """(m, 6) parts of the variance of every slope, rad^2, in the order of `CAUSES`."""
    slopes, solution, level = root.slopes, root.solution, root.level
    own, of_gaps, of_level = _patch_variances(joined, level)
    surer = surer_tilts(joined, surface_normals(solution), np.array(root.up.vector_cam1))
    if level is not None:
        surer[level] = 0.0
    added, variance = own + of_gaps + of_level, slopes.sigma_rad**2
    covariance = slopes.tilt_covariance - added[:, None, None] * np.eye(2) + surer[:, :, None] * surer[:, None]
    if (part := surer.any(axis=1)).any():
        base2 = slope_sigmas(slopes.slope_rad[part], covariance[part]) ** 2
        of_gaps[part] -= np.maximum(base2 + added[part] - variance[part], 0.0)
        added = own + of_gaps + of_level
    along, across = covariance[:, 0, 0], covariance[:, 1, 1]
    counted = np.clip(np.nan_to_num((variance - added - along) / across), 0.0, 1.0)

    def size(part: FloatArray) -> FloatArray:
        return np.asarray(part[:, 0, 0] + counted * part[:, 1, 1])

    parts = tilt_parts(solution, None if level is not None else np.array(root.up.vector_cam1), level)
    motion, camera, reference = (size(part) for part in (parts.motion, parts.camera, parts.reference))
    rest = np.maximum(size(parts.total) - motion - camera - reference, 0.0)
    up = np.full(len(rest), np.radians(root.up.sigma_deg) ** 2) * (1.0 + counted)
    # parts of first order, brought to what is left of the covariance without that of up, and all to the stated sigma
    first = np.column_stack([rest[:, None] * _shares(root, joined, parts.axes[:, 0]), motion, reference, camera])
    first *= _ratio(np.maximum(size(covariance) - up, 0.0), first.sum(axis=1))[:, None]
    matches, relief, gaps, motion, reference, camera = first.T
    base = np.column_stack([matches, relief, gaps, motion, reference + up, camera])
    base *= _ratio(np.maximum(variance - added, 0.0), base.sum(axis=1))[:, None]
    base[:, CAUSES.index("matches")] += own
    base[:, CAUSES.index("gaps")] += of_gaps
    base[:, CAUSES.index("up")] += of_level
    return base


def _patch_variances(joined: Joined, level: int | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(m,) variances of tilts that no residual shows, rad^2, as `measure` adds them: of doubtful matches, of parts
    without matches and borrowed planes, and of the plane taken as level."""
    own, gaps = np.zeros((2, len(joined.patches)))
    for k, patch in enumerate(joined.patches):
        share = min(patch.unmatched_sigma_rad / patch.tilt_sigma_rad, 1.0) if patch.tilt_sigma_rad else 0.0
        own[k] = (1.0 - share) * patch.tilt_sigma_rad**2
        gaps[k] = share * patch.tilt_sigma_rad**2 + borrowed_sigma_rad(patch) ** 2
    return own, gaps, np.full(len(own), 0.0 if level is None else own[level] + gaps[level])


def _shares(root: Measured, joined: Joined, along: FloatArray) -> FloatArray:
    """(m, 3) shares of matches, relief and gaps in the variance of the planes' own noise.

    along : (m, 3) derivatives of the slope by the scaled normals.
    """
    solution, n = root.solution, len(joined.patches)
    shares = np.zeros((n, 3))
    matches = joined.matches
    flat, rough = plane_variances(solution, matches.x1, matches.x2, joined.plane, joined.weight)
    noise, both = (np.einsum("mi,mij,mj->m", along, part, along) for part in (flat, rough))
    shares[:, 0] = np.clip(_ratio(noise, both), 0.0, 1.0)
    shares[:, 1] = 1.0 - shares[:, 0]
    for k, patch in enumerate(joined.patches):
        if patch.dense_shares is not None:
            shares[k] = patch.dense_shares
    return shares


def _ratio(value: FloatArray, of: FloatArray) -> FloatArray:
    """(m,) value / of, 0 where that is nothing."""
    return np.where(of > 0.0, value / np.where(of > 0.0, of, 1.0), 0.0)
