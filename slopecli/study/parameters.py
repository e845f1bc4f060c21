"""What a simulation study varies, with the paper's values (section 4.1) as defaults. Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass

from slopecli.options import Options


@dataclass(frozen=True)
class StudyOptions:
    """Options of `slopemap simulate`; every trajectory, noise and terrain together is one trial."""

    trajectories_deg: tuple[float, ...] = (0.0, 45.0, 90.0)  # of the flight from the vertical
    noises_px: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # 1-sigma, in image 2
    terrains: int = 40
    grid: tuple[int, int] = Options.grid  # columns, rows of windows
    points: int = 30  # in each window
    image_size: tuple[int, int] = (1024, 1024)  # px
    fov_deg: float = 60.0  # horizontal
    baseline_over_height: float = 0.2
    max_slope_deg: float = 40.0  # the paper does not say; 40 deg is steeper than anything a lander bears
    height_spread: float = 0.05  # windows this part of the height above or below the ground; the paper does not say
    rotation_deg: float = 5.0  # between the images; the paper does not say
    heading_deg: float = 0.0  # of the flight, from image x towards image y; the paper flies along x in Fig. 2
    relief: float = 0.0  # RMS height of the points off their plane, over its distance
    noise1_px: float = 0.0  # 1-sigma in image 1
    outliers: float = 0.0  # share of points matched wrongly
    solvers: tuple[str, ...] = ("mle", "ha", "lh")
    most_windows: int = 4096  # in the measurement of time; 0 leaves it out
    seed: int = 0
