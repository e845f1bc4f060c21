"""The benchmarks compare fairly: every peer is asked by its own conventions. Their page has a place for every table."""

from __future__ import annotations

import re
from pathlib import Path

import compare
import numpy as np
import peers
import pytest
import rectified_stereo
import solvers
from documents import write_between
from true_ground import camera_rays, disc_planes

from slopecli.geometry import rotation_from_vector
from slopecli.study import make_scene
from slopecli.types import Camera

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("peer", peers.find_peers()[0], ids=lambda peer: peer.name)
@pytest.mark.parametrize("trajectory", [0.0, 60.0])
def test_peer_is_exact_without_noise(peer: peers.Peer, trajectory: float) -> None:
    """A frame or a half pixel misunderstood would make a peer look bad."""
    scenes = [make_scene(np.random.default_rng(seed), trajectory_deg=trajectory, noise_px=0.0) for seed in range(3)]
    row = solvers.measured(peer, scenes)
    assert max(row.rotation, row.direction, row.normal) < 1e-3  # deg; single precision inside OpenCV
    assert row.wrong == 0


def test_peers_that_are_absent_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(peers.importlib, "import_module", missing)
    found, absent = peers.find_peers()
    assert [peer.name for peer in found] == ["slopemap mle", "slopemap ha", "slopemap lh", "OpenCV, patch by patch"]
    assert [line.split(":")[1].split(",")[0].strip() for line in absent] == ["skipped", "skipped"]


def test_two_answers_count_as_told_and_one_as_wrong() -> None:
    """On flat ground the wrong one of two motions, given alone, is wrong; told with the right one, it is not."""
    flat = [make_scene(np.random.default_rng(3), slopes_deg=[0.0] * 9, height_spread=0.0)]
    ours = peers.find_peers()[0][0]
    both = ours.answer(flat[0])
    assert both.second is not None
    row = solvers.measured(ours, flat)
    assert (row.wrong, row.two) == (0, 1)
    alone = [peers.Answer(one.R, one.T, one.normals) for one in (both, both.second)]
    rows = [solvers.measured(peers.Peer("one", lambda scene, a=answer: a), flat) for answer in alone]
    assert sorted(row.wrong for row in rows) == [0, 1]


def test_page_has_a_place_for_every_table() -> None:
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    for name in compare.SECTIONS:
        before, after = page.split(f"<!-- {name}: begin -->")
        table = after.split(f"<!-- {name}: end -->")[0]
        assert table.strip().startswith("```text"), f"{name} was never filled in"
        assert before.count("```") % 2 == 0


def test_the_first_page_states_the_times_of_the_table() -> None:
    """Within a tenth, as the table is measured anew on other machines than the words are written on."""
    table = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8").split("<!-- commands: begin -->")[1]
    words = (ROOT / "README.md").read_text(encoding="utf-8")
    stated = re.search(
        r"takes `estimate` ([\d.]+) s of processor time and `map` ([\d.]+) s.*?([\d.]+) s a megapixel", words, re.S
    )
    assert stated is not None
    rows = (
        r"estimate, 3x3 windows +[\d.]+ +([\d.]+) s",
        r"\nmap +[\d.]+ +([\d.]+) s",
        r"large pair +[\d.]+ +[\d.]+ s +([\d.]+) s",
    )
    for number, row in zip(stated.groups(), rows, strict=True):
        measured = re.search(row, table)
        assert measured is not None
        assert float(number) == pytest.approx(float(measured[1]), rel=0.1)


def test_a_document_without_marks_is_left_alone(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("nothing here\n")
    with pytest.raises(SystemExit, match="needs the lines"):
        write_between(page, "table", "text")
    assert page.read_text() == "nothing here\n"
    page.write_text("a\n<!-- table: begin -->\nold\n<!-- table: end -->\nb\n")
    write_between(page, "table", "new")
    assert page.read_text() == "a\n<!-- table: begin -->\n\nnew\n\n<!-- table: end -->\nb\n"


# ---- maps ----

CAMERA = Camera(160, 120, 150.0, 150.0, 79.5, 59.5, "brown", (-0.1, 0.02, 0.001, -0.001))
GROUND = np.array([0.2, -0.1, -1.0]) / np.linalg.norm([0.2, -0.1, -1.0])  # normal; the plane is 10 from camera 1


def plane_points() -> np.ndarray:
    """(h, w, 3) points of the pixels on the plane."""
    rays = camera_rays(CAMERA)
    return rays * (-10.0 / (rays @ GROUND))[..., None]


def test_true_planes_of_discs() -> None:
    """On a plane they are that plane; a disc at the corner has a quarter of its ground, and one without any none."""
    points = plane_points()
    planes = disc_planes(points, 4, 21.0)
    assert planes.normal.shape == (30, 40, 3)
    assert np.degrees(np.arccos(np.clip(planes.normal @ GROUND, -1, 1))).max() < 1e-4
    assert planes.share[15, 20] == 1.0
    assert 0.25 < planes.share[0, 0] < 0.45  # the first is centred two pixels inside
    points[:, 80:] = np.nan
    half = disc_planes(points, 4, 21.0)
    assert half.share[15, 19] == pytest.approx(0.5, abs=0.15)
    assert np.isnan(half.slope_deg(np.array([0.0, 0.0, -1.0]))[:, 30:]).all()


@pytest.mark.parametrize("T", [(2.0, 0.1, 0.0), (0.1, -2.0, 0.2), (-1.4, 0.2, 1.4), (1.0, 1.1, -0.9)])
def test_rectified_images_give_points_their_place(T: tuple[float, ...]) -> None:
    """The disparities of a plane, on the rays of image 1, are that plane again."""
    R, motion = rotation_from_vector(np.array([0.02, -0.03, 0.3])), np.array(T)
    turns = rectified_stereo.rotations(CAMERA, R, motion)
    assert np.allclose(turns[1] @ R, turns[0])  # both see the ground from the same side
    x = plane_points().reshape(-1, 3) @ turns[0].T
    pair = rectified_stereo.window_of(turns, CAMERA.focal_px, x[x[:, 2] > 0])
    u, v = np.meshgrid(*(np.arange(n) for n in pair.size))
    rays = np.dstack([(u + pair.first[0]) / pair.focal_px, (v + pair.first[1]) / pair.focal_px, np.ones(u.shape)])
    baseline = turns[0] @ motion
    assert np.allclose(baseline[1:], 0.0, atol=1e-9)
    depth = -10.0 / (rays @ (turns[0] @ GROUND))
    points = rectified_stereo.on_rays(CAMERA, pair, pair.focal_px * baseline[0] / depth, float(baseline[0]))
    known = np.isfinite(points).all(axis=2)
    assert known.mean() > 0.9
    assert np.abs(points[known] @ GROUND + 10.0).max() < 0.01


def test_page_of_maps_has_its_tables() -> None:
    page = (ROOT / "docs" / "map.md").read_text(encoding="utf-8")
    for name in ("map-errors", "map-verdicts", "map-probability", "map-sgbm"):
        table = page.split(f"<!-- {name}: begin -->")[1].split(f"<!-- {name}: end -->")[0]
        assert table.strip().startswith("| "), f"{name} was never filled in"
