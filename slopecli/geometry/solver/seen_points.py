"""Points seen by two cameras, in pixels, so that other cameras can be asked which rays they are; fewer of them; cameras
with another focal length, principal point or radial term."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopecli.geometry.camera import radial_term, rays_from_pixels, with_radial_term
from slopecli.types import BoolArray, Camera, FloatArray, IntArray

ENOUGH = 3000  # matches of the score step: more add time only
ENOUGH_EACH = 24  # of them on one patch, where it has as many


@dataclass(frozen=True, eq=False)
class Sightings:
    """Points seen by two cameras: uv1, uv2 (n, 2) px as stored; patch (n,) number of the plane, -1 for none.

    weight : (n,) inverse relative variances.  gain : of standard errors, by the correlation of neighbours' errors.
    known : what `rays` returns, where it is known: a lens takes a while to undo.
    """

    uv1: FloatArray
    uv2: FloatArray
    patch: IntArray
    weight: FloatArray
    cameras: tuple[Camera, Camera]
    gain: float
    known: tuple[FloatArray, FloatArray] | None = None

    def take(self, which: BoolArray | IntArray) -> Sightings:
        """The points of a mask (n,) or of these indices."""
        known = self.known and (self.known[0][which], self.known[1][which])
        uv1, uv2, patch, weight = self.uv1[which], self.uv2[which], self.patch[which], self.weight[which]
        return Sightings(uv1, uv2, patch, weight, self.cameras, self.gain, known)

    def seen_by(self, cameras: tuple[Camera, Camera]) -> Sightings:
        """The same pixels of other cameras."""
        return replace(self, cameras=cameras, known=None)

    def with_rays(self) -> Sightings:
        """The points that have a ray in both cameras; these are known then."""
        known = replace(self, known=self.rays())
        return known.take(np.asarray(np.isfinite(np.column_stack(known.rays())).all(axis=1)))

    def rays(self) -> tuple[FloatArray, FloatArray]:
        """(n, 2) normalised coordinates in images 1 and 2; NaN where a lens has no ray."""
        return self.known or (rays_from_pixels(self.cameras[0], self.uv1), rays_from_pixels(self.cameras[1], self.uv2))


def together(first: Sightings, second: Sightings) -> Sightings:
    """The points of both, seen by the same cameras, with the gain of the first."""
    patch, weight = np.concatenate([first.patch, second.patch]), np.concatenate([first.weight, second.weight])
    pixels = np.concatenate([first.uv1, second.uv1]), np.concatenate([first.uv2, second.uv2])
    x1, x2 = (np.concatenate(both) for both in zip(first.rays(), second.rays(), strict=True))
    return Sightings(*pixels, patch, weight, first.cameras, first.gain, (x1, x2))


def thinned(sightings: Sightings, most: int = ENOUGH, gain: float = 1.0) -> Sightings:
    """About `most` of the points, the same share of every patch, but at least `ENOUGH_EACH` of each, with their gain.

    gain : factor on standard errors of all points by the correlation of their errors. Of the points left it is less,
    as they are farther apart: standard errors of a thinned lattice are about those of the full one.
    """
    n = len(sightings.patch)
    if n <= most:
        return replace(sightings, gain=gain)
    patch = sightings.patch
    order = np.argsort(patch, kind="stable")
    count = np.bincount(patch + 1)
    rank = np.empty(n)
    rank[order] = np.arange(n) - np.repeat(np.cumsum(count) - count, count)
    share = np.maximum(most / n, ENOUGH_EACH / np.maximum(count, 1))[patch + 1]
    golden = 0.5 * (np.sqrt(5.0) - 1.0)  # spreads any share of the ranks evenly, and along no row of a lattice
    left = sightings.take((golden * rank) % 1.0 < share)
    return replace(left, gain=max(gain * float(np.sqrt(len(left.patch) / n)), 1.0))


def changed(camera: Camera, parameter: str, value: float) -> Camera:
    """A camera whose parameter differs: f by the factor exp(value), cx or cy by value times f, k1 by value."""
    if parameter == "f":
        return replace(camera, fx=camera.fx * float(np.exp(value)), fy=camera.fy * float(np.exp(value)))
    if parameter in ("cx", "cy"):
        return replace(camera, **{parameter: getattr(camera, parameter) + value * camera.focal_px})
    return with_radial_term(camera, radial_term(camera) + value)
