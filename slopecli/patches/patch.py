"""A patch: a part of image 1 held to be one plane, with the matches on that plane."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from slopecli.geometry.statistics import CHI2_MEDIAN, median
from slopecli.look.matches import Matches
from slopecli.patches import FINDER_OF, Finder
from slopecli.patches.footprint import Footprint
from slopecli.types import FloatArray, IntArray, Segmentation
from slopecli.windows import Window

REFERENCE_PX = 0.05  # 1-sigma of a match of weight 1


@dataclass(frozen=True, eq=False)
class Patch:
    """A part of image 1 held to be one plane. A finder makes it without matches, then gives it some, or a reason.

    Attributes
    ----------
    id : the number users know it by.  source : that of its finder in `FINDERS`.  footprint : its pixels of image 1.
    matches : (n) on its plane.  weight : (n,) inverse variance along the epipolar line, relative to REFERENCE_PX.
    cell : (n, 2) row and column of the matches on a lattice; errors of neighbouring matches are correlated.
    origin : "own" where the matches lie in the patch, "borrowed" where they are those of the plane around it, "none".
    score : correlation of the images after matching.  share : of the patch that is matched.
    reason, code : why it is borrowed or has no matches, in words and as a diagnostic code.
    tilt_sigma_rad : 1-sigma of the tilt in addition to what the residuals tell.
    unmatched_sigma_rad : the part of it that is due to parts of the patch without matches.
    off_plane_sigma_rad : the part of that which is due to unmatched parts that are not on the plane.
    left_out : share of the matches found that was left out, far off the plane or across a step.
    """

    id: int
    source: str
    footprint: Footprint
    matches: Matches = field(default_factory=Matches.none)
    weight: FloatArray = field(default_factory=lambda: np.empty(0))
    cell: IntArray = field(default_factory=lambda: np.empty((0, 2), np.int64))
    origin: Literal["own", "borrowed", "none"] = "none"
    score: float = 0.0
    share: float = 0.0
    reason: str = ""
    code: str = ""
    tilt_sigma_rad: float = 0.0
    unmatched_sigma_rad: float = 0.0
    off_plane_sigma_rad: float = 0.0
    left_out: float = 0.0

    @property
    def window(self) -> Window:
        """The rectangle around it, which for a window is the window."""
        return self.footprint.bounds

    @property
    def finder(self) -> Finder:
        """The row of `FINDERS` it comes from."""
        return FINDER_OF[self.source]

    def unmatched(self, reason: str, code: str = "low-texture") -> Patch:
        """This patch without matches, with the reason in words and as a diagnostic code."""
        return replace(Patch(self.id, self.source, self.footprint), reason=reason, code=code)


class Found(NamedTuple):
    """What a finder returns: patches in the order of their ids, and, for pictures, the steps of a segmentation."""

    patches: list[Patch]
    segmentation: Segmentation | None = None


def weight_of(variance_px2: FloatArray) -> FloatArray:
    """(n,) weights of matches of these noise variances, px of image 2 squared."""
    return REFERENCE_PX**2 / variance_px2


def overdispersion(normalised_squares: FloatArray) -> float:
    """Robust ratio of the variance of a patch's residuals to that predicted from its texture, at least 0.25.

    The fewer residuals there are, the less a ratio below 1 is trusted: of 20 or fewer it is at least 1.

    normalised_squares : (n,) squared residuals over their predicted variances.
    """
    least = np.interp(len(normalised_squares), [20, 60], [1.0, 0.25])
    return max(median(normalised_squares) / CHI2_MEDIAN, float(least))
