"""What a worker does with a pair: the files of `slopemap estimate`, or an outcome that says why there are none."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from batch_factory import SIDE, make_images, make_job, make_pair, make_pairs, tree
from remembered import remembered
from report_factory import make_ambiguity, make_camera, make_report

import slopecli.batch.answer as room
from slopecli.batch import Answer, CameraChoice, Job, Keep, Pair, Shipped, answer_jobs, load_inputs, store
from slopecli.batch.answer import answer
from slopecli.errors import DiskFull, InputError
from slopecli.io import load_image, write_outputs
from slopecli.io.cameras import camera_for
from slopecli.look import features
from slopecli.options import Options
from slopecli.pipeline import estimate

QUICK = Options(grid=(1, 1))  # where it does not matter what the answer is


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return make_images(tmp_path_factory.mktemp("views"), 4)


@pytest.fixture
def pairs(images: list[Path]) -> list[Pair]:
    return make_pairs(images)


@pytest.fixture(autouse=True)
def _no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test begins as a fresh worker does, but for answers that others have had."""
    room._memory.clear()
    monkeypatch.setattr(room, "estimate", remembered)


def without_record(folder: str) -> dict[str, bytes]:
    return {name: content for name, content in tree(Path(folder)).items() if name != "pair.json"}


def as_the_command_does(pair: Pair, folder: Path, options: Options, keep: frozenset[str]) -> dict[str, bytes]:
    images = load_image(pair.image1), load_image(pair.image2)
    assert pair.camera1 is not None
    cameras = [camera_for(image, pair.camera1)[0] for image in images]
    report = estimate(*images, *cameras, options)
    write_outputs(report, images[0], folder, keep)
    return tree(folder)


@pytest.mark.parametrize(
    ("options", "keep"),
    [
        (Options(), Keep()),
        (Options(grid=(2, 2), baseline_m=1.5), Keep(overlay=False, ply=False)),
        pytest.param(
            Options(planes="regions", up="dominant-plane"),
            Keep(glb=False, debug_images=True),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["windows", "few files", "regions"],
)
def test_the_files_are_those_of_the_command(
    pairs: list[Pair], tmp_path: Path, options: Options, keep: frozenset[str]
) -> None:
    job = make_job(pairs[0], tmp_path / "batch", options, keep)
    outcome = answer(job).outcome
    assert outcome.exit_status == 0
    alone = as_the_command_does(pairs[0], tmp_path / "alone", options, keep)
    assert without_record(job.folder) == alone
    assert set(outcome.files) == set(alone)
    assert outcome.files[0] == "slopes.json"


def test_the_outcome_counts_what_slopes_json_says(pairs: list[Pair], tmp_path: Path) -> None:
    import json

    job = make_job(pairs[0], tmp_path)
    outcome = answer(job).outcome
    result = json.loads((Path(job.folder) / "slopes.json").read_text())
    planes = result["planes"]
    assert outcome.n_planes == len(planes) > 0
    assert outcome.n_rejected == len(result["rejected"])
    verdicts = [plane["verdict"] for plane in planes]
    counts = [verdicts.count(verdict) for verdict in ("safe", "unsafe", "undecided")]
    assert [outcome.n_safe, outcome.n_unsafe, outcome.n_undecided] == counts
    good = [plane for plane in planes if plane["status"] == "ok"]
    assert outcome.n_ok == len(good)
    steepest = max(good, key=lambda plane: plane["slope_deg"])
    assert outcome.steepest_deg == pytest.approx(steepest["slope_deg"], abs=1e-6)
    assert outcome.steepest_sigma_deg == pytest.approx(steepest["slope_sigma_deg"], abs=1e-6)
    assert outcome.noise_px == pytest.approx(result["fit"]["noise_px"], abs=1e-6)
    assert outcome.ambiguity == result["ambiguity"]["status"]
    assert list(outcome.diagnostics) == [diagnostic["code"] for diagnostic in result["diagnostics"]]


def test_the_outcome_has_the_steepest_plane_of_either_answer(
    pairs: list[Pair], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The steeper answer first, whichever the solver prefers; a plane that is poor in the first has no say."""
    report = make_report(make_camera(SIDE, SIDE))
    good = tuple(replace(plane, status="poor" if plane.id == 6 else "ok") for plane in report.planes)
    report = replace(report, planes=good, ambiguity=make_ambiguity(report))
    monkeypatch.setattr(room, "estimate", lambda *_, **__: report)
    outcome = answer(make_job(pairs[0], tmp_path)).outcome
    assert outcome.exit_status == 0
    assert (outcome.steepest_deg, outcome.steepest_sigma_deg) == (42.0, 0.7)
    assert (outcome.steepest_other_deg, outcome.steepest_other_sigma_deg) == (22.0, 0.6)


def counted(monkeypatch: pytest.MonkeyPatch, place: Any, name: str) -> list[Any]:
    calls: list[Any] = []
    real = getattr(place, name)

    def counting(*args: Any, **kwargs: Any) -> Any:
        calls.append(args)
        return real(*args, **kwargs)

    monkeypatch.setattr(place, name, counting)
    return calls


@pytest.mark.slow
def test_neighbours_share_what_was_decoded_and_found_and_nobody_can_tell(
    pairs: list[Pair], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "estimate", estimate)
    decoded = counted(monkeypatch, room, "decode_image")
    found = counted(monkeypatch, features, "detect_sift")
    together = [make_job(pair, tmp_path / "together") for pair in pairs]
    answer_jobs(together)
    assert len(decoded) == len(pairs) + 1
    efforts = [effort for _, effort in found]
    assert all(efforts.count(effort) <= len(pairs) + 1 for effort in features.EFFORTS)
    for pair in pairs:
        room._memory.clear()
        alone = make_job(pair, tmp_path / "alone")
        answer(alone)
        assert tree(Path(alone.folder)) == tree(tmp_path / "together" / pair.name)


def test_the_memory_does_not_grow(pairs: list[Pair], tmp_path: Path) -> None:
    answer_jobs([make_job(pair, tmp_path, QUICK) for pair in pairs])
    assert len(room._memory._images) == 2  # those of a pair


def test_a_finished_pair_is_looked_up(pairs: list[Pair], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job = make_job(pairs[0], tmp_path, QUICK)
    first = answer(job)
    before = tree(tmp_path)
    monkeypatch.setattr(room, "estimate", lambda *_, **__: pytest.fail("was estimated again"))
    again = answer(job)
    assert (first.kept, again.kept) == (False, True)
    assert again.outcome == first.outcome
    assert tree(tmp_path) == before


@pytest.mark.parametrize("what", ["options", "image", "camera"])
def test_a_pair_is_answered_anew_when_something_has_changed(tmp_path: Path, what: str) -> None:
    paths = make_images(tmp_path / "views", 2)
    job = make_job(make_pairs(paths)[0], tmp_path / "out", QUICK)
    before = answer(job).outcome
    if what == "options":
        job = replace(job, options=Options(grid=(2, 2)))
    elif what == "image":
        cv2.imwrite(str(paths[1]), cv2.GaussianBlur(cv2.imread(str(paths[1])), (3, 3), 0.5))
    else:
        camera = paths[0].parent / "camera.json"
        camera.write_text(camera.read_text().replace("692.8", "693.8"))
    now = answer(job)
    assert not now.kept
    assert now.outcome.fingerprint != before.fingerprint
    assert now.outcome.exit_status == 0


# ---- pairs without an answer ----


def spoil_empty(path: Path) -> None:
    path.write_bytes(b"")


def spoil_cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:3000])


def spoil_text(path: Path) -> None:
    path.write_text("this is not an image, whatever its name says\n")


def spoil_missing(path: Path) -> None:
    path.unlink()


def spoil_directory(path: Path) -> None:
    path.unlink()
    path.mkdir()


def spoil_size(path: Path) -> None:
    cv2.imwrite(str(path), cv2.imread(str(path))[: SIDE - 20])


SPOILERS = [spoil_empty, spoil_cut, spoil_text, spoil_missing, spoil_directory, spoil_size]


@pytest.mark.parametrize("spoil", SPOILERS, ids=lambda spoil: spoil.__name__.removeprefix("spoil_"))
def test_a_bad_image_is_named_and_the_pair_is_answered_once_it_is_good(
    tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    paths = make_images(tmp_path / "views", 2)
    good = paths[1].read_bytes()
    spoil(paths[1])
    job = make_job(make_pairs(paths)[0], tmp_path / "out", QUICK)
    outcome = answer(job).outcome
    assert outcome.exit_status == 1
    assert outcome.code in ("input", "unreadable")
    assert str(paths[1]) in str(outcome.message)
    assert "\n" not in str(outcome.message)
    assert set(tree(Path(job.folder))) == {"pair.json"}
    if paths[1].is_dir():
        paths[1].rmdir()
    paths[1].write_bytes(good)
    assert answer(job).outcome.exit_status == 0


def test_of_two_bad_images_both_are_named(tmp_path: Path) -> None:
    for bad in (spoil_missing, spoil_text):
        paths = make_images(tmp_path / bad.__name__, 2)
        bad(paths[0])
        spoil_size(paths[1])
        outcome = answer(make_job(make_pairs(paths)[0], tmp_path / "out")).outcome
        assert all(str(path) in str(outcome.message) for path in paths)


def test_a_file_that_is_missing_for_a_moment_is_named(
    pairs: list[Pair], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, calls = room.read_image_file, list[str]()

    def late(path: str, base: str) -> bytes:
        calls.append(path)
        if len(calls) == 1:
            raise InputError(f"{path}: no such file")
        return real(path, base)

    monkeypatch.setattr(room, "read_image_file", late)
    outcome = answer(make_job(pairs[0], tmp_path)).outcome
    assert (outcome.code, outcome.message) == ("unreadable", f"{pairs[0].image1}: no such file")


def test_a_pair_that_cannot_tell_has_the_reason_and_the_remedy(tmp_path: Path) -> None:
    paths = make_images(tmp_path / "views", 2)
    cv2.imwrite(str(paths[1]), np.full((SIDE, SIDE), 128, np.uint8))
    job = make_job(make_pairs(paths)[0], tmp_path / "out")
    first, again = answer(job), answer(job)
    outcome = first.outcome
    assert outcome.exit_status == 3
    assert outcome.code
    assert outcome.message
    assert outcome.remedy
    assert again.kept  # the same bytes have no other answer
    assert again.outcome == outcome


def test_a_bad_camera_is_named(tmp_path: Path) -> None:
    paths = make_images(tmp_path / "views", 2)
    (tmp_path / "views" / "camera.json").write_text('{"fx": ')
    outcome = answer(make_job(make_pairs(paths)[0], tmp_path / "out")).outcome
    assert (outcome.exit_status, outcome.code) == (1, "input")
    assert "camera.json" in str(outcome.message)


def test_a_pair_with_a_problem_is_not_tried(images: list[Path], tmp_path: Path) -> None:
    pair = Pair("odd", str(images[0]), "", None, None, problem="odd: holds three images, needed two")
    outcome = answer(make_job(pair, tmp_path)).outcome
    assert (outcome.exit_status, outcome.message) == (1, pair.problem)


class OpenCVError(Exception):
    code = -4


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (MemoryError(), "memory"),
        (OpenCVError("Insufficient memory"), "memory"),
        (ValueError("std::bad_alloc"), "memory"),
        (IndexError("list index\nout of range"), "unexpected"),
    ],
)
def test_what_goes_wrong_inside_is_an_outcome_and_is_tried_again(
    pairs: list[Pair], tmp_path: Path, error: Exception, code: str
) -> None:
    job = make_job(pairs[0], tmp_path, QUICK)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(room, "estimate", lambda *_, **__: (_ for _ in ()).throw(error))
        outcome = answer(job).outcome
    assert (outcome.exit_status, outcome.code) == (1, code)
    assert "\n" not in str(outcome.message)
    assert outcome.remedy
    assert answer(job).outcome.exit_status == 0


@pytest.mark.parametrize(("error", "code"), [(MemoryError(), "memory"), (IndexError("odd"), "unexpected")])
@pytest.mark.parametrize("place", ["read_image_file", "fingerprint_of", "finished"])
def test_what_goes_wrong_around_the_estimate_is_an_outcome_too(
    pairs: list[Pair], tmp_path: Path, error: Exception, code: str, place: str
) -> None:
    job = make_job(pairs[0], tmp_path, QUICK)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(room, place, lambda *_, **__: (_ for _ in ()).throw(error))
        outcome = answer(job).outcome
    assert (outcome.exit_status, outcome.code) == (1, code)
    assert answer(job).outcome.exit_status == 0


def test_a_full_disk_is_not_the_fault_of_a_pair(
    pairs: list[Pair], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DiskFull, match=pairs[0].name):
        answer(make_job(pairs[0], tmp_path, QUICK))
    assert not tree(tmp_path)


# ---- without shared paths ----


def shipped(job: Job) -> Job:
    loaded = load_inputs(job)
    assert isinstance(loaded, Shipped)
    return replace(job, shipped=loaded)


def test_a_shipped_job_needs_no_file_and_comes_to_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = make_images(tmp_path / "views", 2)
    pair = make_pairs(paths)[0]
    here, there = make_job(pair, tmp_path / "here", QUICK), shipped(make_job(pair, tmp_path / "there", QUICK))
    answer(here)
    for path in (tmp_path / "views").iterdir():
        path.unlink()
    sent = answer(there)
    assert not (tmp_path / "there").exists()
    assert sent.contents is not None
    store(there, sent.outcome, sent.contents)
    assert tree(tmp_path / "there") == tree(tmp_path / "here")


def test_a_camera_of_several_in_a_file_is_found_in_a_shipped_job(images: list[Path], tmp_path: Path) -> None:
    file = tmp_path / "cameras.txt"
    file.write_text("1 PINHOLE 800 800 692.8 692.8 400 400\n2 PINHOLE 800 800 700 700 400 400\n")
    jobs = [
        make_job(make_pair(*images[:2], CameraChoice(f"{file}#{name}")), tmp_path / name, QUICK) for name in ("1", "2")
    ]
    sent = [answer(shipped(job)) for job in jobs]
    assert [one.outcome.exit_status for one in sent] == [0, 0]
    assert sent[0].outcome.fingerprint != sent[1].outcome.fingerprint
    for job, one in zip(jobs, sent, strict=True):
        assert one.contents == without_record(answer_stored(job))


def answer_stored(job: Job) -> str:
    answer(job)
    return job.folder


def test_of_a_finished_pair_nothing_is_shipped(pairs: list[Pair], tmp_path: Path) -> None:
    job = make_job(pairs[0], tmp_path, QUICK)
    outcome = answer(job).outcome
    assert load_inputs(job) == Answer(outcome, kept=True)


def test_paths_may_be_relative_to_another_folder_than_that_of_the_worker(images: list[Path], tmp_path: Path) -> None:
    folder = images[0].parent
    pair = make_pair(Path(images[0].name), Path(images[1].name), CameraChoice("camera.json"))
    job = replace(make_job(pair, tmp_path, QUICK), base=str(folder))
    outcome = answer(job).outcome
    assert outcome.exit_status == 0
    assert outcome.image1 == images[0].name
