"""Image pairs whose ground is known at every pixel of image 1, and the true planes of discs of it.

The rendered pairs below SLOPEMAP_DATA have a depth at every pixel (`depth.npz`); the pair of sample_data/descent has
one after its own terrain is asked again, which needs no data.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry import rays_from_pixels
from slopecli.io import load_image
from slopecli.types import Camera, Image

SAMPLE_DATA = Path(__file__).resolve().parent.parent / "sample_data"
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class TrueGround:
    """A pair with its camera, and what image 1 shows.

    set_name : of the row of a table.  up : (3,) against gravity, camera-1 axes.
    points : (h, w, 3) ground at the pixel centres of image 1, camera-1 axes, m; NaN where it shows none.
    visible : (h, w) whether image 2 shows that ground.
    """

    name: str
    set_name: str
    images: tuple[Image, Image]
    camera: Camera
    up: FloatArray
    points: FloatArray
    visible: BoolArray


def true_grounds(data: Path | None, sets: dict[str, str], only: str = "") -> Iterator[TrueGround]:
    """The sample pair, then the rendered pairs below a folder whose names begin as `sets` says: beginning -> set."""
    if only in "sample_data/descent":
        yield sample_ground()
    for start, set_name in sets.items():
        for path in sorted(data.glob(f"**/{start}*/truth.json")) if data else []:
            truth = json.loads(path.read_text(encoding="utf-8"))
            usable = truth.get("expected", {}).get("verdict") != "refuse"
            for ground in _rendered(path.parent, truth, set_name) if usable else ():
                if only in ground.name:
                    yield ground


def _rendered(folder: Path, truth: dict[str, Any], set_name: str) -> Iterator[TrueGround]:
    """The pair of a folder, or every image of a sequence with the next one."""
    if "frames" not in truth:
        files = truth["image1"], truth["image2"], truth["depth"], truth["visible"]
        yield _ground(folder, truth, truth["name"], set_name, truth["up_cam1"], files)
        return
    for first, second in zip(truth["frames"][:-1], truth["frames"][1:], strict=True):
        files = first["image"], second["image"], first["depth"], f"visible_next_{first['index']:02d}.png"
        yield _ground(folder, truth, f"{truth['name']}/{first['index']:02d}", set_name, first["up_cam"], files)


def _ground(
    folder: Path, truth: dict[str, Any], name: str, set_name: str, up: list[float], files: tuple[str, str, str, str]
) -> TrueGround:
    K, lens = truth["K"], tuple(truth.get("dist") or ())
    model = "brown" if any(lens) else "pinhole"
    numbers = K[0][0], K[1][1], K[0][2], K[1][2]
    camera = Camera(truth["width"], truth["height"], *numbers, model, lens if any(lens) else ())
    depth = np.load(folder / files[2])["depth"].astype(np.float64)
    depth[~np.isfinite(depth) | (depth <= 0)] = np.nan
    visible = cv2.imread(str(folder / files[3]), cv2.IMREAD_GRAYSCALE)
    if visible is None:
        sys.exit(f"{folder / files[3]}: cannot be read as an image")
    images = load_image(str(folder / files[0])), load_image(str(folder / files[1]))
    points = camera_rays(camera) * depth[..., None]
    return TrueGround(name, set_name, images, camera, np.array(up), points, visible > 0)


def sample_ground() -> TrueGround:
    """The pair of sample_data/descent; its terrain is built again and its rays are cast again."""
    sys.path.insert(0, str(SAMPLE_DATA))
    from descent_pair import descent_views, visible_from
    from heightfield import RayCaster
    from terrain import CELL, build_terrain

    first, second = descent_views()
    caster = RayCaster(build_terrain().height, CELL)
    u, v = np.meshgrid(np.arange(first.width, dtype=float), np.arange(first.height, dtype=float))
    rays = first.rays(u, v)
    depth = caster.depth(first.centre, rays.reshape(-1, 3)).reshape(u.shape)
    world = first.centre + depth[..., None] * rays
    numbers = first.camera_file()
    lens = tuple(numbers.pop("distortion"))
    camera = Camera(**numbers, model="brown", distortion=lens)
    folder = SAMPLE_DATA / "descent"
    images = load_image(str(folder / "image1.png")), load_image(str(folder / "image2.png"))
    points, up = first.to_camera(world), first.rotation[:, 2]
    visible = visible_from(second, caster, world)
    return TrueGround("sample_data/descent", "sample_data/descent", images, camera, up, points, visible)


def camera_rays(camera: Camera) -> FloatArray:
    """(h, w, 3) rays of all pixels with z = 1."""
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    x = rays_from_pixels(camera, np.column_stack([u.ravel(), v.ravel()]))
    return np.dstack([x.reshape(*u.shape, 2), np.ones_like(u)])


@dataclass(frozen=True, eq=False)
class DiscPlanes:
    """Planes of discs of ground around cells (rows, columns): the nearest by perpendicular distance.

    normal (..., 3): unit, towards camera 1.  share: of a whole disc's pixels, those that have ground.
    """

    normal: FloatArray
    share: FloatArray

    def slope_deg(self, up: FloatArray) -> FloatArray:
        """Angle of the normals to up, NaN where there is no ground."""
        across = np.linalg.norm(np.cross(self.normal, up), axis=-1)
        return np.degrees(np.arctan2(across, self.normal @ up))


def disc_planes(points: FloatArray, spacing_px: int, diameter_px: float) -> DiscPlanes:
    """Planes of the discs around the cells of a map, each centred on the pixel nearest to its cell, as footprints are.

    points (h, w, 3) : NaN where there is no ground.
    """
    known = np.isfinite(points).all(axis=2)
    if not known.any():
        cells = points[::spacing_px, ::spacing_px]
        return DiscPlanes(np.full_like(cells, np.nan), np.zeros(cells.shape[:2]))
    origin = points[known].mean(axis=0)
    x = np.where(known[..., None], points - origin, 0.0)
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    layers = [known.astype(float), *np.moveaxis(x, 2, 0), *(x[..., a] * x[..., b] for a, b in pairs)]
    whole, sums = _disc_sums(layers, spacing_px, diameter_px)
    count = np.maximum(sums[0], 1.0)
    mean = np.stack(sums[1:4], -1) / count[..., None]
    second = np.empty((*count.shape, 3, 3))
    for (a, b), total in zip(pairs, sums[4:], strict=True):
        second[..., a, b] = second[..., b, a] = total / count - mean[..., a] * mean[..., b]
    normal = np.linalg.eigh(second)[1][..., 0]
    normal = np.where(((normal * (mean + origin)).sum(-1) > 0)[..., None], -normal, normal)
    share = np.minimum(sums[0] / whole, 1.0)
    return DiscPlanes(np.where((sums[0] > 2)[..., None], normal, np.nan), share)


def _disc_sums(layers: list[FloatArray], spacing_px: int, diameter_px: float) -> tuple[float, list[FloatArray]]:
    """Number of pixels of a disc, and the sums (rows, columns) of layers over the discs; 0 beyond the border."""
    first = int(np.round(0.5 * spacing_px - 0.5))  # of two pixels as near, the even one; so it is for every cell
    off = np.arange(-int(np.ceil(0.5 * diameter_px)), int(np.ceil(0.5 * diameter_px)) + 1)
    disc = (off**2 + off[:, None] ** 2 <= (0.5 * diameter_px) ** 2).astype(float)
    rows, columns = (n // spacing_px for n in layers[0].shape)
    at = np.s_[first : first + rows * spacing_px : spacing_px, first : first + columns * spacing_px : spacing_px]
    sums = [cv2.filter2D(layer, cv2.CV_64F, disc, borderType=cv2.BORDER_CONSTANT)[at] for layer in layers]
    return float(disc.sum()), sums
