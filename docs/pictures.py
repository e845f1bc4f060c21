"""Pictures of docs/segment.md and docs/map.md, made from the samples by running the command. `make docs` runs it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

ROOT = Path(__file__).resolve().parent.parent
URBAN = ROOT / "sample_data" / "urban"
WIDTH, THIRD = 900, 440  # px of a single picture, and of one of three side by side
MOST_BYTES, MAP_BYTES = 150_000, 400_000
PAPER, INK = (250, 250, 250), (40, 40, 40)
GRADIENT, COMPONENTS, MERGED = "step1_gradient.png", "step2_components.png", "step3_merged.png"

# picture -> what stands side by side: options of the run, which of its pictures, caption
STRIPS: dict[str, list[tuple[tuple[str, ...], str, str]]] = {
    "segment_steps": [
        ((), GRADIENT, "1, 2: gradient and threshold"),
        ((), COMPONENTS, "3: components"),
        ((), MERGED, "4-7: planes, merged"),
    ],
    "segment_gradient_threshold": [
        (("--gradient-threshold", "1"), COMPONENTS, "--gradient-threshold 1"),
        ((), COMPONENTS, "as the image asks for"),
        (("--gradient-threshold", "10"), COMPONENTS, "--gradient-threshold 10"),
    ],
    "segment_merge_px": [
        (("--merge-px", "0.2"), MERGED, "--merge-px 0.2"),
        ((), MERGED, "--merge-px 1, the default"),
        (("--merge-px", "4"), MERGED, "--merge-px 4"),
    ],
    "segment_min_region": [
        (("--min-region", "0.1"), MERGED, "--min-region 0.1"),
        ((), MERGED, "--min-region 0.3, the default"),
        (("--min-region", "2"), MERGED, "--min-region 2"),
    ],
}
# points of view on the model: turned about the vertical through its middle, and height of the look, degrees
VIEWS = ((-30.0, 34.0), (35.0, 26.0))
VIEW_WIDTH, VIEW_HEIGHT, VIEW_FOV_DEG = 660, 480, 50.0
SUPERSAMPLING = 2
LATTICE = 6  # points along each side of a triangle


def make_pictures(folder: Path, images: Path) -> None:
    """Run the command into `folder` and write the pictures into `images`."""
    plain = _segmented(folder, ())
    overlay = _shown(cv2.imread(str(plain / "overlay.png")), WIDTH)
    _write(images / "segment_overlay.jpg", overlay)
    for name, parts in STRIPS.items():
        pictures = [
            _shown(_above_caption(_segmented(folder, options) / picture), THIRD) for options, picture, _ in parts
        ]
        _write(images / f"{name}.jpg", _side_by_side(pictures, [caption for *_, caption in parts]))
    model = read_model(plain / "patches.glb")
    _write(images / "segment_model.jpg", _side_by_side([render(*model, *view) for view in VIEWS], ["", ""]))


def write_map_picture(source: Path, images: Path) -> None:
    """Write a map at its own size: its legend has small text."""
    _write(images / "map.jpg", cv2.imread(str(source)), MAP_BYTES)


def write_camera_picture(source: Path, images: Path) -> None:
    """Write the picture of a camera at its own size."""
    _write(images / "camera.jpg", cv2.imread(str(source)), MAP_BYTES)


def write_validation_picture(source: Path, images: Path) -> None:
    """Write the figure of `slopemap validate`, a little smaller."""
    _write(images / "validation.jpg", _shown(cv2.imread(str(source)), WIDTH))


def _segmented(folder: Path, options: Sequence[str]) -> Path:
    """Output folder of a run with these options, which is run if it was not."""
    out = folder / ("segment" + "".join(options))
    if not out.exists():
        pair = [str(URBAN / name) for name in ("image1.png", "image2.png")]
        command = [sys.executable, "-m", "slopecli", "segment", *pair, "--camera", str(URBAN / "camera.json")]
        subprocess.run(
            [*command, "-q", "--debug-images", "-o", str(out), *options], stdout=subprocess.DEVNULL, check=True
        )
    return out


def _above_caption(path: Path) -> Picture:
    """A step's picture without the strip of text below it, which would be too small to read."""
    picture = cv2.imread(str(path))
    height, width = cv2.imread(str(URBAN / "image1.png")).shape[:2]
    return np.asarray(picture[: round(picture.shape[1] * height / width)], np.uint8)


def _shown(picture: Picture, width: int) -> Picture:
    size = (width, round(picture.shape[0] * width / picture.shape[1]))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def _side_by_side(pictures: Sequence[Picture], captions: Sequence[str]) -> Picture:
    """Pictures of one height in a row, each with its caption below."""
    columns = []
    for picture, caption in zip(pictures, captions, strict=True):
        strip = np.full((26 if caption else 0, picture.shape[1], 3), PAPER, np.uint8)
        if caption:
            cv2.putText(strip, caption, (4, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
        columns += [np.vstack([picture, strip]), np.full((len(picture) + len(strip), 6, 3), PAPER, np.uint8)]
    return np.hstack(columns[:-1])


def _write(path: Path, picture: Picture, most_bytes: int = MOST_BYTES) -> None:
    """Write a JPEG as good as its size allows."""
    for quality in range(88, 30, -4):
        _, coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
        if len(coded) < most_bytes:
            break
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(coded.tobytes())


# ---- the textured model, seen from elsewhere ----


def read_model(path: Path) -> tuple[NDArray[np.float64], Picture]:
    """Points (n, 3), y up, that cover the surfaces of a textured model densely, and their colours (n, 3) BGR."""
    points, colours = [], []
    for name, mesh in trimesh.load(path).geometry.items():
        if name.startswith("plane"):
            texture = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))[..., ::-1]
            weights = _barycentric(LATTICE)
            points.append((weights @ mesh.vertices[mesh.faces]).reshape(-1, 3))
            uv = (weights @ mesh.visual.uv[mesh.faces]).reshape(-1, 2)
            u, v = uv[:, 0] * (texture.shape[1] - 1), (1 - uv[:, 1]) * (texture.shape[0] - 1)
            colours.append(texture[np.rint(v).astype(int), np.rint(u).astype(int)])
    return np.concatenate(points), np.concatenate(colours)


def _barycentric(count: int) -> NDArray[np.float64]:
    """(k, 3) weights of a lattice of points on a triangle, `count` along each side."""
    i, j = np.divmod(np.arange(count * count), count)
    inside = i + j < count
    first, second = i[inside] / (count - 1), j[inside] / (count - 1)
    return np.column_stack([first, second, 1 - first - second])


def render(points: NDArray[np.float64], colours: Picture, turn_deg: float, elevation_deg: float) -> Picture:
    """The points as a camera sees them that looks at their middle, turned from where camera 1 stood (the origin)."""
    width, height = SUPERSAMPLING * VIEW_WIDTH, SUPERSAMPLING * VIEW_HEIGHT
    focal = width / 2 / np.tan(np.radians(VIEW_FOV_DEG / 2))
    middle = np.median(points, axis=0)
    heading = np.arctan2(-middle[0], -middle[2]) + np.radians(turn_deg)
    elevation = np.radians(elevation_deg)
    back = np.array([np.sin(heading) * np.cos(elevation), np.sin(elevation), np.cos(heading) * np.cos(elevation)])
    right = np.array([np.cos(heading), 0.0, -np.sin(heading)])
    seen = (points - middle - np.linalg.norm(middle) * back) @ np.stack([right, np.cross(right, back), -back]).T
    u, v = (np.rint(focal * seen[:, k] / seen[:, 2] + (size - 1) / 2) for k, size in ((0, width), (1, height)))
    visible = (seen[:, 2] > 0) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    order = np.flatnonzero(visible)[np.argsort(-seen[visible, 2], kind="stable")]  # the nearest is painted last
    picture, covered = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
    at = v[order].astype(int), u[order].astype(int)
    picture[at], covered[at] = colours[order], 1.0
    # gaps between points are filled from the pixels around them
    share = cv2.resize(cv2.blur(covered, (2, 2)), (VIEW_WIDTH, VIEW_HEIGHT), interpolation=cv2.INTER_AREA)[..., None]
    mean = cv2.resize(cv2.blur(picture, (2, 2)), (VIEW_WIDTH, VIEW_HEIGHT), interpolation=cv2.INTER_AREA)
    filled = np.where(share > 0.3, mean / np.maximum(share, 0.3), np.array(PAPER))
    return np.asarray(np.clip(filled, 0, 255), np.uint8)
