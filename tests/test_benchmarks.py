"""The benchmarks compare fairly: every peer is asked by its own conventions. Their page has a place for every table."""

from __future__ import annotations

from pathlib import Path

import compare
import numpy as np
import peers
import pytest
import solvers
from documents import write_between

from slopecli.study import make_scene

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


def test_a_document_without_marks_is_left_alone(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("nothing here\n")
    with pytest.raises(SystemExit, match="needs the lines"):
        write_between(page, "table", "text")
    assert page.read_text() == "nothing here\n"
    page.write_text("a\n<!-- table: begin -->\nold\n<!-- table: end -->\nb\n")
    write_between(page, "table", "new")
    assert page.read_text() == "a\n<!-- table: begin -->\n\nnew\n\n<!-- table: end -->\nb\n"
