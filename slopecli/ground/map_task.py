"""A map out of the dense depth of a pair and the report of its solution: cells, sizes on the ground, landing sites."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.slope import north_direction
from slopecli.geometry.statistics import median
from slopecli.ground.cell_grid import CellGrid, choose_cells
from slopecli.ground.cell_map import WITHHELD, CellMap, Demand, map_cells
from slopecli.ground.near_miss import nearest_miss
from slopecli.ground.safety import least_limit
from slopecli.ground.sites import Ground, find_sites
from slopecli.ground.slope_map import CellArrays, SlopeMap
from slopecli.ground.tilt_uncertainty import Root, wholly_shown
from slopecli.look.dense_depth import DenseDepth
from slopecli.look.scene import Scene
from slopecli.options import MapOptions, Options
from slopecli.types import FloatArray, Report


@dataclass(frozen=True, eq=False)
class MapTask:
    """What a map is made of, once the pair is solved.

    scene : with the motion and the cameras of the answer.  roots : that motion, and the second if it is not ruled out.
    up_sigma_rad : of the vertical.  forbidden : codes of diagnostics that forbid to call anything safe.
    """

    scene: Scene
    report: Report
    roots: Sequence[Root]
    up_sigma_rad: float
    forbidden: Sequence[str]
    options: Options
    wanted: MapOptions

    @property
    def length(self) -> float:
        """Length of the baseline, in the unit of the scale."""
        return float(np.linalg.norm(self.report.motion.baseline_cam1))

    @property
    def unit(self) -> str:
        """Of lengths, as messages call it."""
        return "m" if self.report.scale.unit == "m" else "baselines"

    def ground_px(self, share: float = 0.5) -> float:
        """Size on the ground of a pixel of image 1 at this quantile of its distance, in the unit of the scale."""
        depth = np.quantile(1.0 / self.scene.evidence.w, share)
        return float(depth) * self.length / self.scene.camera1.focal_px


def sizes_of(task: MapTask, grid_scale: float) -> CellGrid:
    """Spacing and footprint of the cells of a map.

    Raises
    ------
    InputError : a footprint, spacing or limit of height that the pixels of the images cannot serve.
    """
    wanted, footprint_px = task.wanted, task.wanted.footprint_px
    size = wanted.footprint_m
    if size is not None and task.unit != "m":
        raise InputError("--footprint-m needs a scale; give --baseline, --altitude or --pose, or --footprint in px")
    if footprint_px is None and size is None and wanted.lander is not None:
        size = wanted.lander.diameter + wanted.lander.pad
    if size is not None:
        footprint_px = size / task.ground_px()
    _refuse_height(task, grid_scale)
    width, height = task.scene.camera1.width, task.scene.camera1.height
    return choose_cells(width, height, grid_scale, footprint_px, wanted.spacing_px)


def _refuse_height(task: MapTask, grid_scale: float) -> None:
    if task.wanted.max_height is None:
        return
    pixel = task.ground_px(0.05) / grid_scale
    least = least_limit(pixel, task.options.confidence)
    if task.wanted.max_height < least:
        unit = 10.0 ** (math.floor(math.log10(least)) - 2)
        enough = f"{math.ceil(least / unit) * unit:.3g}"  # rounded up: what is asked for is then taken
        raise InputError(
            f"--max-height {task.wanted.max_height:g} {task.unit} cannot be promised: at {pixel:.3g} "
            f"{task.unit} a pixel on the nearest ground, heights are known to {enough} {task.unit} with confidence "
            f"{task.options.confidence:g}; give at least {enough}, or images taken from nearer"
        )


def build_map(depth: DenseDepth, cells: CellGrid, task: MapTask) -> SlopeMap:
    """Measure every cell, and choose landing sites."""
    report, options = task.report, task.options
    up = np.array(report.up.vector_cam1)
    ups = [up] if report.up.otherwise_cam1 is None else [up, np.array(report.up.otherwise_cam1)]
    north = None if options.north is None else np.array(options.north, float)
    demand = Demand(
        ups=ups,
        up_sigma_rad=task.up_sigma_rad,
        north=north_direction(up, north),
        length=task.length,
        scale_sigma=report.scale.sigma or 0.0,
        tolerance_rad=float(np.radians(options.tolerance_deg)),
        max_height=task.wanted.max_height,
    )
    camera = task.scene.camera1
    places = cells.over(camera.width, camera.height, depth.grid)
    measured = map_cells(depth, places, task.roots, demand)
    if task.forbidden:
        measured = replace(measured, p_safe=np.minimum(measured.p_safe, WITHHELD))
    # no site reaches onto what image 2 does not show or is no ground, nor up to it: nobody knows what is there
    shown = wholly_shown(task.scene.shown(depth.grid, depth.uv2) | depth.known, places)
    sure = replace(measured, p_safe=np.where(shown, measured.p_safe, np.minimum(measured.p_safe, WITHHELD)))
    ground = _ground(depth, cells, sure, demand, task)
    radius_px = _site_radius(task)
    sites = find_sites(ground, task.wanted, radius_px)
    return SlopeMap(
        **{field.name: getattr(measured, field.name) for field in fields(CellArrays)},
        spacing_px=cells.spacing_px,
        footprint_px=cells.footprint_px,
        footprint=_footprint(measured, cells, depth),
        tolerance_deg=options.tolerance_deg,
        confidence=options.confidence,
        classes_deg=task.wanted.classes_deg,
        sites=sites,
        no_site="" if sites or not task.wanted.sites else _no_site(ground, task, radius_px),
        north_cam1=options.north,
        report=report,
        sigma_causes_deg=measured.sigma_causes_deg,
    )


def _no_site(ground: Ground, task: MapTask, radius_px: float | None) -> str:
    """Why there is no landing site."""
    if task.forbidden:
        return f"nothing is called safe as long as there is the warning {', '.join(dict.fromkeys(task.forbidden))}"
    return nearest_miss(ground, task.wanted, radius_px)


def _footprint(measured: CellMap, cells: CellGrid, depth: DenseDepth) -> float:
    """Diameter of a footprint on the ground at the median distance, in the unit of the scale."""
    known = measured.ground_px[np.isfinite(measured.ground_px)]
    return cells.footprint_px * depth.grid.mean_scale * median(known) if len(known) else float("nan")


def _site_radius(task: MapTask) -> float | None:
    """Wanted radius of a site, px of image 1."""
    wanted = task.wanted.site_radius
    return wanted if wanted is None or task.unit != "m" else wanted / task.ground_px()


def _ground(depth: DenseDepth, cells: CellGrid, measured: CellMap, demand: Demand, task: MapTask) -> Ground:
    scene, R = task.scene, task.roots[0].R
    T = task.roots[0].T * task.length

    def pixels2(points: FloatArray) -> FloatArray:
        moved = (points - T) @ R.T
        ahead = moved[:, 2:] > 0
        return scene.pixels2(np.where(ahead, moved[:, :2] / np.where(ahead, moved[:, 2:], 1.0), np.nan))

    return Ground(
        slope_deg=measured.slope_deg,
        sigma_deg=measured.sigma_deg,
        p_safe=measured.p_safe,
        above_plane_max=measured.above_plane_max,
        below_plane_max=measured.below_plane_max,
        step=measured.step,
        points=measured.points,
        spacing_px=cells.spacing_px,
        footprint_px=cells.footprint_px,
        surface=depth.points * np.float32(task.length),
        known=depth.known,
        grid_scale=depth.grid.scale,
        shape1=scene.shape1,
        shape2=scene.shape2,
        up=demand.ups[0],
        confidence=task.options.confidence,
        tolerance_rad=demand.tolerance_rad,
        max_height=demand.max_height,
        pixels2=pixels2,
        R=R,
        T=T,
        unit=task.unit,
    )
