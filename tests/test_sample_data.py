"""The sample pairs agree with their truth, which is derived here anew from the files alone."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

FOLDER = Path(__file__).resolve().parent.parent / "sample_data"
SCENES = ("descent", "urban")


class Scene:
    """The files of one pair, and where its planes send pixels of image 1."""

    def __init__(self, folder: Path) -> None:
        self.images = [cv2.imread(str(folder / f"image{k}.png"), cv2.IMREAD_GRAYSCALE) for k in (1, 2)]
        self.camera = json.loads((folder / "camera.json").read_text())
        self.truth = json.loads((folder / "truth.json").read_text())
        c = self.camera
        self.K = np.array([[c["fx"], 0, c["cx"]], [0, c["fy"], c["cy"]], [0, 0, 1]])
        self.distortion = np.array(c["distortion"], dtype=float)
        self.R, self.T = np.array(self.truth["R"]), np.array(self.truth["T"])
        self.up = np.array(self.truth["up_cam1"])

    def rays(self, uv: NDArray[Any]) -> NDArray[Any]:
        """(n, 3) viewing rays of pixels (n, 2), z = 1."""
        x = cv2.undistortPoints(uv.reshape(-1, 1, 2).astype(float), self.K, self.distortion)
        return np.column_stack([x.reshape(-1, 2), np.ones(len(uv))])

    def transfer(self, uv: NDArray[Any], plane: dict[str, Any], T: NDArray[Any] | None = None) -> NDArray[Any]:
        """Where points (n, 2) of image 1 that lie on a plane appear in image 2."""
        rays = self.rays(uv)
        depth = plane["distance_m"] / -(rays @ plane["normal_cam1"])
        points = depth[:, None] * rays - (self.T if T is None else T)
        return cv2.projectPoints(points @ self.R.T, np.zeros(3), np.zeros(3), self.K, self.distortion)[0].reshape(-1, 2)

    def agreement(self, uv: NDArray[Any], plane: dict[str, Any], T: NDArray[Any] | None = None) -> float:
        """Correlation of image 1 at pixels (n, 2) with image 2 where the plane sends them."""
        target = self.transfer(uv, plane, T).astype(np.float32)
        rows, columns = self.images[1].shape
        inside = np.all((target > 1) & (target < [columns - 2, rows - 2]), axis=1)
        seen = sample(self.images[1], target[inside])
        return float(np.corrcoef(self.images[0][uv[inside, 1], uv[inside, 0]], seen)[0, 1])


def sample(image: NDArray[Any], uv: NDArray[Any]) -> NDArray[Any]:
    """Grey values (n,) at (n, 2); in rows of 1024 because cv2.remap wants an image-like map."""
    padded = np.resize(uv, (-(-len(uv) // 1024) * 1024, 2)).reshape(-1, 1024, 2).astype(np.float32)
    return cv2.remap(image, padded, None, cv2.INTER_CUBIC).ravel()[: len(uv)]


def angle_deg(a: NDArray[Any], b: NDArray[Any]) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))))


def pixels_of(window: dict[str, Any]) -> NDArray[Any]:
    u, v = np.meshgrid(np.arange(window["w"]) + window["x"], np.arange(window["h"]) + window["y"])
    return np.column_stack([u.ravel(), v.ravel()])


@pytest.fixture(scope="module")
def scenes() -> dict[str, Scene]:
    return {name: Scene(FOLDER / name) for name in SCENES}


def stated_planes(scene: Scene) -> list[dict[str, Any]]:
    return [plane for key in ("windows", "smooth_windows", "planes") for plane in scene.truth.get(key, [])]


@pytest.mark.parametrize("name", SCENES)
def test_motion_and_up_are_proper(scenes: dict[str, Scene], name: str) -> None:
    scene = scenes[name]
    assert np.allclose(scene.R @ scene.R.T, np.eye(3), atol=1e-11)
    assert np.linalg.det(scene.R) > 0
    assert np.linalg.norm(scene.up) == pytest.approx(1, abs=1e-11)
    assert 1 < angle_deg(scene.R @ [0, 0, 1], np.array([0, 0, 1])) < 3


@pytest.mark.parametrize("name", SCENES)
def test_camera_file_fits_the_images(scenes: dict[str, Scene], name: str) -> None:
    camera = scenes[name].camera
    assert all(image.shape == (camera["height"], camera["width"]) for image in scenes[name].images)
    assert (camera["cx"], camera["cy"]) == ((camera["width"] - 1) / 2, (camera["height"] - 1) / 2)


@pytest.mark.parametrize("name", SCENES)
def test_normals_face_the_camera_and_give_the_slopes(scenes: dict[str, Scene], name: str) -> None:
    scene = scenes[name]
    for plane in stated_planes(scene):
        normal = np.array(plane["normal_cam1"])
        assert np.linalg.norm(normal) == pytest.approx(1, abs=1e-8)
        assert plane["distance_m"] > 0, "the camera is on the side the normal points to"
        assert angle_deg(normal, scene.up) == pytest.approx(plane["slope_deg"], abs=1e-4)


def test_grid_windows_are_the_default_grid(scenes: dict[str, Scene]) -> None:
    edges = [0, 267, 533, 800]
    expected = [
        (edges[i], edges[j], edges[i + 1] - edges[i], edges[j + 1] - edges[j]) for j in range(3) for i in range(3)
    ]
    windows = scenes["descent"].truth["windows"]
    assert [window["id"] for window in windows] == list(range(1, 10))
    assert [(window["x"], window["y"], window["w"], window["h"]) for window in windows] == expected


def test_slopes_are_on_both_sides_of_what_landers_bear(scenes: dict[str, Scene]) -> None:
    slopes = [window["slope_deg"] for window in scenes["descent"].truth["windows"]]
    assert min(slopes) < 5
    assert 20 < max(slopes) < 30
    assert sum(slope < 13 for slope in slopes) >= 3
    assert sum(slope > 17 for slope in slopes) >= 3


def test_smooth_windows_carry_their_texture_into_image_2(scenes: dict[str, Scene]) -> None:
    """0.97 leaves room for relief of 1-2 cm (a fifth of a pixel) and noise; level ground at the same place is worse."""
    scene = scenes["descent"]
    assert len(scene.truth["smooth_windows"]) >= 6
    for window in scene.truth["smooth_windows"]:
        uv = pixels_of(window)
        assert window["visible_fraction"] >= 0.99
        truth = scene.agreement(uv, window)
        assert truth > 0.97, window
        if window["slope_deg"] > 5:
            centre = scene.rays(uv.mean(axis=0, keepdims=True))[0]
            depth = window["distance_m"] / -(centre @ window["normal_cam1"])
            level = {"normal_cam1": [0, 0, -1], "distance_m": depth}
            assert scene.agreement(uv, level) < truth - 0.01, window


def test_urban_planes_carry_their_texture_into_image_2(scenes: dict[str, Scene]) -> None:
    """Planes that image 2 sees whole are exact: only noise and resampling separate the images. 3 % less T is worse."""
    scene = scenes["urban"]
    labels = cv2.imread(str(FOLDER / "urban" / "labels.png"), cv2.IMREAD_UNCHANGED)
    judged = 0
    for plane in scene.truth["planes"]:
        inside = cv2.erode((labels == plane["id"]).astype(np.uint8), np.ones((5, 5)))
        if plane["visible_fraction"] > 0.99 and inside.sum() > 2000:
            uv = np.argwhere(inside)[:, ::-1]
            truth = scene.agreement(uv, plane)
            assert truth > 0.97, plane["name"]
            assert scene.agreement(uv, plane, T=0.97 * scene.T) < truth - 0.05, plane["name"]
            judged += 1
    assert judged >= 6


def test_labels_are_the_listed_planes(scenes: dict[str, Scene]) -> None:
    labels = cv2.imread(str(FOLDER / "urban" / "labels.png"), cv2.IMREAD_UNCHANGED)
    assert labels.dtype == np.uint8
    planes = scenes["urban"].truth["planes"]
    assert set(np.unique(labels)) - {0} == {plane["id"] for plane in planes}
    assert all(plane["pixels"] == np.sum(labels == plane["id"]) for plane in planes)
    assert planes[0]["name"] == "ground"
    assert planes[0]["slope_deg"] == 0


@pytest.mark.parametrize("name", SCENES)
def test_independent_matches_obey_the_motion(scenes: dict[str, Scene], name: str) -> None:
    """Distances of feature matches to their epipolar lines: a half-pixel or sign error would show as 0.3 px or more."""
    scene = scenes[name]
    sift = cv2.SIFT_create(3000, enable_precise_upscale=True)
    (points1, words1), (points2, words2) = (sift.detectAndCompute(image, None) for image in scene.images)
    pairs = cv2.BFMatcher().knnMatch(words1, words2, k=2)
    matches = [best for best, second in pairs if best.distance < 0.7 * second.distance]
    rays1 = scene.rays(np.array([points1[match.queryIdx].pt for match in matches]))
    rays2 = scene.rays(np.array([points2[match.trainIdx].pt for match in matches]))
    lines = np.cross(scene.T, rays1) @ scene.R.T
    distance = scene.camera["fx"] * np.abs(np.sum(lines * rays2, axis=1)) / np.hypot(lines[:, 0], lines[:, 1])
    assert len(matches) > 800
    assert np.median(distance) < 0.12
    assert np.mean(distance < 1) > 0.9


@pytest.mark.slow
def test_the_script_gives_these_very_files(tmp_path: Path) -> None:
    """Equal to one grey level; where machines round differently a shadow's edge may move across a sample or two."""
    command = [sys.executable, str(FOLDER / "make_sample_data.py"), "--output", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    files = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.*"))
    assert len(files) == 9
    for file in files:
        if file.suffix == ".png":
            new, old = (cv2.imread(str(root / file), cv2.IMREAD_UNCHANGED) for root in (tmp_path, FOLDER))
            assert new.shape == old.shape
            assert np.mean(np.abs(new.astype(int) - old) > 1) < 1e-4, file
        else:
            new, old = (json.loads((root / file).read_text()) for root in (tmp_path, FOLDER))
            assert close(new, old), file


def close(new: Any, old: Any) -> bool:
    """Equal structure, text and whole numbers, other numbers to 1e-4."""
    if isinstance(new, dict):
        return new.keys() == old.keys() and all(close(new[key], old[key]) for key in new)
    if isinstance(new, list):
        return len(new) == len(old) and all(close(a, b) for a, b in zip(new, old, strict=True))
    return new == pytest.approx(old, abs=1e-4) if isinstance(new, float) else new == old


# ---- the flight that make_sequence.py renders ----


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A flight of two images and one of three."""
    folders = tmp_path_factory.mktemp("two"), tmp_path_factory.mktemp("three")
    for count, folder in enumerate(folders, 2):
        command = [sys.executable, str(FOLDER / "make_sequence.py"), str(folder), "--count", str(count)]
        subprocess.run(command, check=True)
    return folders


@pytest.mark.slow
def test_a_shorter_flight_is_the_beginning_of_a_longer_one(flights: tuple[Path, Path]) -> None:
    names = ["camera.json", "frame_0001.png", "frame_0002.png"]
    two, three = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in flights)
    assert sorted(two) == names
    assert sorted(three) == [*names, "frame_0003.png"]
    assert {name: three[name] for name in names} == two
    assert cv2.imread(str(flights[0] / names[1])).shape == (240, 320, 3)


@pytest.mark.slow
def test_neighbours_of_a_flight_overlap_in_most_of_the_image(monkeypatch: pytest.MonkeyPatch) -> None:
    """On level ground at height 0; the site itself rises and falls by a few metres."""
    monkeypatch.syspath_prepend(str(FOLDER))
    flight = list(importlib.import_module("make_sequence").views(201, 320, 240))
    u, v = np.meshgrid(np.linspace(0, 319, 20), np.linspace(0, 239, 20))
    for first, second in pairwise(flight):
        rays = first.rays(u, v)
        ground = first.centre - first.centre[2] / rays[..., 2:] * rays
        assert second.contains(*second.project(ground)[:2]).mean() > 0.6


def test_matches_are_what_their_script_makes() -> None:
    made = subprocess.run(
        [sys.executable, str(FOLDER / "make_matches.py")], capture_output=True, text=True, encoding="utf-8", check=True
    ).stdout
    shown, now = (np.genfromtxt(text.splitlines()[1:], delimiter=",") for text in
                  ((FOLDER / "matches.csv").read_text(encoding="utf-8"), made))  # fmt: skip
    assert now == pytest.approx(shown, abs=2e-3)


@pytest.mark.slow
def test_depth_of_the_descent_has_the_true_planes_of_its_windows(scenes: dict[str, Scene], tmp_path: Path) -> None:
    subprocess.run([sys.executable, str(FOLDER / "make_depth.py"), str(tmp_path / "depth.npy")], check=True)
    depth, scene = np.load(tmp_path / "depth.npy"), scenes["descent"]
    assert depth.shape == scene.images[0].shape
    for window in scene.truth["windows"]:
        x, y, w, h = (window[key] for key in "xywh")
        u, v = (grid.ravel() for grid in np.meshgrid(np.arange(x, x + w), np.arange(y, y + h)))
        points = scene.rays(np.column_stack([u, v])) * depth[v, u, None]
        _, axes = np.linalg.eigh(np.cov(points.T.astype(float)))
        slope_deg = np.degrees(np.arccos(abs(axes[:, 0] @ scene.up)))
        assert slope_deg == pytest.approx(window["slope_deg"], abs=0.02)
