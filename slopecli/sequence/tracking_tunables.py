"""Numbers of the tracker, each with its unit and its reason."""

from __future__ import annotations

from typing import NamedTuple


class TrackingTunables(NamedTuple):
    """As measured on rendered descents and flights; see docs/sequence.md."""

    per_window: int = 225  # points of a window: 144 lose a tenth of the accuracy, 400 cost twice the time
    # points of all windows, so that a grid of a hundred costs about twice that of nine, which half of them are for;
    # where windows are fewer, one has four times `per_window` at most: its cells are as small as windows of alignment
    in_all: int = 4000
    outside: int = 200  # points outside the windows, for the motion alone
    kept_views: int = 5  # whole views; older ones are summed up
    open_views: int = 8  # the same while two answers are left, when nothing is summed up
    shared_errors: int = 12  # variables for the errors of the motions of views summed up; more change nothing
    new_view: float = 0.1  # of its baseline: a view that moved less replaces the last, as errors repeat
    lk_px: int = 17  # window of Lucas and Kanade on the aligned frame; nearer to a border than half of it none fits
    coarse_points: int = 400  # points by which the motion between two frames is found
    # of the coarse points, those that agree with a motion, and correlation of the aligned frame with the reference, of
    # which a moving shadow leaves 0.7: with less the frame is not understood
    least_agreement: float = 0.4
    least_points: int = 12  # twice the numbers of a motion: with fewer points one is not believed
    tells_less: float = 1.3  # times the 1-sigma of the best test of the camera, from which on another tells nothing new
    misses: int = 2  # frames in turn whose track contradicts the rest, after which it is given up
    same_grey: float = 0.2  # mean difference of two frames, grey levels, below which one repeats the other
    sharpness: float = 0.65  # of the frame used before: with less, in any direction, a frame is blurred
    # frames in turn that are blurred, after which the next is taken, as the ground itself may be smoother; or that do
    # not go with the first one, after which the next is the first
    in_turn: int = 4
    least_sampling: float = 0.2  # of the variance that independent points would have; see `halves_ratio`
    shared_cells: int = 3  # cells along the side of a square whose points err alike; a window has 15 along its own
    rough: float = 0.02  # relief over the distance that ground is taken to have until it is measured
    new_reference: float = 0.25  # of the points in view, below which the last frame becomes a reference, too
    most_zoom: float = 1.6  # px of a frame to one of its reference, above which it becomes one, too
    later_points: int = 64  # of each ninth of a later reference: motions need a quarter of the points of slopes
    next_depth: float = 1.25  # times the baseline of the last frame kept for depth, from which on another is kept

    @property
    def border_px(self) -> int:
        """Points so near the border of an image are not tracked."""
        return self.lk_px // 2 + 1


TRACKING = TrackingTunables()
