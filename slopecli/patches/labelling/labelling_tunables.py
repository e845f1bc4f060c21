"""Parameters of the search for planes among points: of the finder `ransac` and of `label_planes`."""

from __future__ import annotations

from typing import NamedTuple


class LabellingTunables(NamedTuple):
    """All of them, each with its unit and the reason for its value."""

    # the energy, nats
    neighbours: int = 6  # nearest points that every point is joined with: as many as a triangulation gives
    # the search
    eager: float = 0.3  # share of its price a plane must save to be tried: two may be worth it only together
    # the finder ransac
    plane: float = 40.0  # nats, price of a plane, of ten cells that nothing else explains; of a homography twice that
    ransac_scale_px: tuple[float, float] = (0.2, 1.0)  # of residuals: matches are no better, flat surfaces no worse
    ransac_points: int = 2500  # among which planes are sought; all are labelled in the end
    ransac_judges: int = 1200  # of them, on which proposals compete
    ransac_around: int = 24  # nearest points that propose a plane: fewer are noisier, more cross edges
    # label_planes; its coordinates have about unit size
    smooth: float = 0.5  # nats for two neighbours on different planes; twice that for cells, which are closer
    ceiling: float = 0.01  # largest scale, share of the diagonal of image 2's points: rougher surfaces are no planes
    points: int = 500  # among which planes are sought; all are labelled in the end
    seeds: int = 300  # points around which planes are proposed
    around: int = 10  # nearest points that samples are drawn from: with more, small planes are missed
    samples: int = 16  # drawn around every seed: one without mismatch is among them even if half are


LABELLING = LabellingTunables()
