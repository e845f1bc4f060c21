"""The output folder: all files or none, never half of one, and none that belongs to another result."""

from __future__ import annotations

import errno
import json
import os
import signal
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from killed_writer import Killed, kill_at
from output_names import files_of
from report_factory import (
    make_camera,
    make_image,
    make_region_labels,
    make_region_report,
    make_report,
    make_segmentation,
)

from slopecli.errors import InputError
from slopecli.io import check_directory, temporary_folder, write_outputs
from slopecli.options import Place, Position
from slopecli.products import (
    MAP_PRODUCTS,
    OUTPUT_NAMES,
    PRODUCTS,
    SEQUENCE_PRODUCTS,
    STREAM,
    VIDEO,
    draw_merged,
    keep_files,
    kept_choices,
    report_to_json,
)
from slopecli.types import Scale

ALL = files_of()
FOUND = files_of(requires=("found",))
STEPS = files_of(requires=("segmentation",), also=("debug_images",)) - ALL
REPORT, IMAGE = make_report(), make_image()
SMALL_IMAGE = make_image(320, 240, colour=True)
SMALL_LABELS = make_region_labels(320, 240)
REGIONS = make_region_report(make_camera(320, 240), SMALL_LABELS, segmentation=make_segmentation(SMALL_LABELS, 160))


def test_every_file_has_a_row_and_the_result_completes_them() -> None:
    files = [product.file for product in (*PRODUCTS, *MAP_PRODUCTS, *SEQUENCE_PRODUCTS)]
    assert set(OUTPUT_NAMES) == {*files, VIDEO, STREAM}
    assert len(OUTPUT_NAMES) == len(set(OUTPUT_NAMES))
    assert OUTPUT_NAMES[-1] == "slopes.json"
    position = Position(46.6, 8.0, None, 1.0, 2.0, 1.0)
    placed = replace(REGIONS, place=Place(position, (0.0, -1.0, 0.0), 0.0, 0.0), scale=Scale("m", "baseline", 0.0))
    assert all(product.what and product.encode(placed, SMALL_IMAGE) for product in PRODUCTS)


def test_the_files_that_users_know_are_there() -> None:
    assert {"slopes.json", "planes.csv", "overlay.png", "patches.ply", "labels.png", "labels_colour.png"} <= ALL
    assert ALL | {"patches.glb"} <= FOUND
    assert {"step1_gradient.png", "step2_components.png", "step3_merged.png"} <= STEPS
    assert {"slopes.json", "planes.csv", "slope_map.tif", "map.png", "map_sigma.png"} <= files_of(MAP_PRODUCTS)
    assert {"slopes.json", "planes.csv", "overlay.png", "trajectory.txt"} <= files_of(SEQUENCE_PRODUCTS)
    assert not {"overlay.png", "patches.ply", "labels_colour.png"} & files_of(without=("overlay", "ply"))


def test_flags_decline_or_ask_for_files() -> None:
    flags = {product.parameter: product.flag for product in PRODUCTS if product.choice}
    assert {flags["no_overlay"], flags["debug_images"]} == {"--no-overlay", "--debug-images"}
    assert kept_choices(dict.fromkeys(flags, False)) == keep_files() >= {"overlay", "ply", "glb"}
    asked = kept_choices(dict.fromkeys(flags, True))
    assert "debug_images" in asked
    assert not asked & keep_files()


def test_there_is_no_other_choice() -> None:
    with pytest.raises(TypeError, match="overlays"):
        keep_files(overlays=False)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def one_line(error: pytest.ExceptionInfo[InputError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    assert "-o" in text  # what to try
    return text


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    """A folder with all that an earlier answer can be and something of the user's own."""
    for name in OUTPUT_NAMES:
        (tmp_path / name).write_bytes(f"earlier {name}".encode())
    (tmp_path / "notes.txt").write_text("mine")
    return tmp_path


def test_writes_the_four_files_of_windows_and_says_which(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    written = write_outputs(REPORT, IMAGE, folder)
    assert written[0] == folder / "slopes.json"
    assert {path.name for path in written} == ALL == set(contents(folder))
    assert json.loads((folder / "slopes.json").read_text()) == json.loads(report_to_json(REPORT))


def test_labels_keep_sixteen_bits(tmp_path: Path) -> None:
    labels = REPORT.labels.copy()
    labels[10:20, 10:20] = 40_000
    write_outputs(make_report(labels=labels), IMAGE, tmp_path)
    read = cv2.imread(str(tmp_path / "labels.png"), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.uint16
    assert np.array_equal(read, labels)


def test_overlay_is_the_picture_in_its_colours(tmp_path: Path) -> None:
    write_outputs(REPORT, IMAGE, tmp_path)
    picture = cv2.imread(str(tmp_path / "overlay.png"))
    assert picture.shape[1] == IMAGE.width
    blue, _, red = np.median(picture[365:375, 20:60].reshape(-1, 3), axis=0)
    assert blue > red + 30  # window 7: 2 degrees


def test_same_report_gives_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_outputs(REPORT, IMAGE, tmp_path / name)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_replaces_an_earlier_answer_and_nothing_else(earlier: Path) -> None:
    write_outputs(REPORT, IMAGE, earlier)
    now = contents(earlier)
    assert set(now) == ALL | {"notes.txt"}
    assert now["notes.txt"] == b"mine"
    assert not any(content.startswith(b"earlier") for content in now.values())


def test_files_left_out_do_not_stay_from_an_earlier_run(earlier: Path) -> None:
    written = write_outputs(REPORT, IMAGE, earlier, keep_files(overlay=False, ply=False))
    assert {path.name for path in written} == files_of(without=("overlay", "ply"))
    assert set(contents(earlier)) == files_of(without=("overlay", "ply")) | {"notes.txt"}


@pytest.mark.parametrize(
    "declined",
    [set(), {"overlay"}, {"ply"}, {"glb"}, {"overlay", "ply", "glb"}],
    ids=lambda names: "+".join(sorted(names)) or "none",  # the order of a set is another in every process
)
def test_regions_come_with_a_textured_model(earlier: Path, declined: set[str]) -> None:
    written = write_outputs(REGIONS, SMALL_IMAGE, earlier, keep_files(**dict.fromkeys(declined, False)))
    expected = files_of(requires=("found",), without=declined)
    assert {path.name for path in written} == expected
    assert set(contents(earlier)) == expected | {"notes.txt"}
    assert not any(content.startswith(b"earlier") for content in contents(earlier).values())


def test_steps_are_written_when_asked_for_and_there_are_any(tmp_path: Path) -> None:
    write_outputs(REGIONS, SMALL_IMAGE, tmp_path, keep_files(debug_images=True))
    assert set(contents(tmp_path)) == FOUND | STEPS
    merged = cv2.imread(str(tmp_path / "step3_merged.png"))
    assert np.array_equal(merged, draw_merged(REGIONS, SMALL_IMAGE))
    write_outputs(make_region_report(make_camera(320, 240)), SMALL_IMAGE, tmp_path, keep_files(debug_images=True))
    assert set(contents(tmp_path)) == FOUND  # found without a segmentation
    write_outputs(REPORT, IMAGE, tmp_path, keep_files(debug_images=True))
    assert set(contents(tmp_path)) == ALL


def test_same_regions_give_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_outputs(REGIONS, SMALL_IMAGE, tmp_path / name, keep_files(debug_images=True))
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def fail_in(monkeypatch: pytest.MonkeyPatch, name: str, at: int, error: BaseException) -> None:
    """Let the `at`-th call of an os function raise."""
    real, calls = getattr(os, name), iter(range(1, 1000))

    def function(*arguments: Any) -> Any:
        if next(calls) == at:
            raise error
        return real(*arguments)

    monkeypatch.setattr(os, name, function)


@pytest.mark.parametrize(("name", "at"), [("fsync", 1), ("fsync", 4), *(("rename", at) for at in range(1, 13))])
def test_full_disk_leaves_everything_as_it_was(
    earlier: Path, monkeypatch: pytest.MonkeyPatch, name: str, at: int
) -> None:
    before = contents(earlier)
    fail_in(monkeypatch, name, at, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    with pytest.raises(InputError) as error:
        write_outputs(REPORT, IMAGE, earlier)
    assert "No space left" in one_line(error)
    assert contents(earlier) == before


@pytest.mark.parametrize(("name", "at"), [("fsync", 2), ("rename", 3)])
def test_failure_in_a_new_folder_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, at: int
) -> None:
    fail_in(monkeypatch, name, at, OSError(errno.EIO, "Input/output error"))
    with pytest.raises(InputError):
        write_outputs(REPORT, IMAGE, tmp_path / "new" / "folder")
    assert not list(tmp_path.iterdir())


def test_interruption_leaves_everything_as_it_was(earlier: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = contents(earlier)
    fail_in(monkeypatch, "rename", 10, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        write_outputs(REPORT, IMAGE, earlier)
    assert contents(earlier) == before


def test_a_file_where_the_folder_should_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError) as error:
            write_outputs(REPORT, IMAGE, folder)
        assert "is not a folder" in one_line(error)
    assert contents(tmp_path) == {"file": b"mine"}


def test_a_folder_where_a_file_should_be_is_kept(tmp_path: Path) -> None:
    (tmp_path / "overlay.png").mkdir()
    (tmp_path / "overlay.png" / "precious").write_text("mine")
    with pytest.raises(InputError) as error:
        write_outputs(REPORT, IMAGE, tmp_path)
    assert "overlay.png" in one_line(error)
    assert (tmp_path / "overlay.png" / "precious").read_text() == "mine"


def test_a_link_is_replaced_and_its_target_kept(tmp_path: Path) -> None:
    target, folder = tmp_path / "kept.json", tmp_path / "out"
    target.write_text("mine")
    folder.mkdir()
    (folder / "slopes.json").symlink_to(target)
    write_outputs(REPORT, IMAGE, folder)
    assert target.read_text() == "mine"
    assert not (folder / "slopes.json").is_symlink()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write anywhere")
def test_no_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError) as error:
        write_outputs(REPORT, IMAGE, tmp_path / "out")
    assert "permission" in one_line(error)


def test_name_that_no_file_system_takes(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        write_outputs(REPORT, IMAGE, tmp_path / ("x" * 300))
    one_line(error)


def test_check_changes_nothing(tmp_path: Path) -> None:
    check_directory(tmp_path / "new" / "folder")
    assert not list(tmp_path.iterdir())


# ---- writers that are killed ----


@pytest.mark.parametrize("step", range(1, 36))
def test_after_a_kill_the_result_is_there_only_with_all_of_its_files(earlier: Path, step: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        kill_at(patch, step)
        with suppress(Killed):
            write_outputs(REPORT, IMAGE, earlier)
    there = {name: content for name, content in contents_of_files(earlier).items() if name in OUTPUT_NAMES}
    if "slopes.json" in there:
        are_old = {content.startswith(b"earlier") for content in there.values()}
        assert len(are_old) == 1, sorted(there)
        assert set(there) == (set(OUTPUT_NAMES) if are_old == {True} else ALL)
    write_outputs(REPORT, IMAGE, earlier)  # the next run
    assert set(contents(earlier)) == ALL | {"notes.txt"}


def contents_of_files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_what_another_process_is_about_to_write_stays(tmp_path: Path) -> None:
    (tmp_path / ".slopemap-killed").mkdir()
    (tmp_path / ".slopemap-killed" / "slopes.json").write_text("half")
    with temporary_folder(tmp_path) as other:
        assert [path.name for path in tmp_path.iterdir()] == [other.name]
        write_outputs(REPORT, IMAGE, tmp_path)
        assert other.is_dir()
    assert set(contents(tmp_path)) == ALL


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_until_all_files_have_their_names(
    earlier: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    real = os.rename

    def disturbed(*arguments: Any) -> None:
        signal.raise_signal(number)
        real(*arguments)

    def handler(*_: object) -> None:
        raise Killed

    before = signal.signal(number, handler)
    try:
        monkeypatch.setattr(os, "rename", disturbed)
        with pytest.raises(Killed):
            write_outputs(REPORT, IMAGE, earlier)
        assert signal.getsignal(number) is handler
    finally:
        signal.signal(number, before)
    assert set(contents(earlier)) == ALL | {"notes.txt"}


# ---- inputs ----


def input_is(path: Path) -> Any:
    return make_report(images=(replace(REPORT.images[0], path=str(path)), REPORT.images[1]))


def test_an_input_is_not_replaced_however_it_is_spelled(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    picture = out / "overlay.png"
    picture.write_bytes(b"mine")
    (tmp_path / "link").symlink_to(out)
    (tmp_path / "soft.png").symlink_to(picture)
    os.link(picture, tmp_path / "hard.png")
    for path in (picture, out / ".." / "out" / "overlay.png", *(tmp_path / name for name in ("soft.png", "hard.png"))):
        with pytest.raises(InputError) as error:
            write_outputs(input_is(path), IMAGE, tmp_path / "link")
        assert "is an input" in one_line(error)
        assert contents(out) == {"overlay.png": b"mine"}
    write_outputs(input_is(tmp_path / "none.png"), IMAGE, out)


def test_inputs_that_are_not_among_the_names_do_no_harm(tmp_path: Path) -> None:
    (tmp_path / "image.png").write_bytes(b"mine")
    inputs = [str(tmp_path / "image.png"), "-", None, "", "nowhere#1", "a\0b", "x" * 5000]
    check_directory(tmp_path, inputs=inputs)
    (tmp_path / "slopes.json").write_text("a camera")
    with pytest.raises(InputError, match="is an input"):
        check_directory(tmp_path, inputs=[*inputs, f"{tmp_path / 'slopes.json'}#left"])


def test_labels_in_colours_show_every_plane_apart_from_its_neighbours(tmp_path: Path) -> None:
    write_outputs(REGIONS, SMALL_IMAGE, tmp_path)
    picture = cv2.imread(str(tmp_path / "labels_colour.png"))
    colours = {i: np.unique(picture[i == SMALL_LABELS], axis=0) for i in np.unique(SMALL_LABELS)}
    assert all(len(of_plane) == 1 for of_plane in colours.values())
    assert len({tuple(of_plane[0]) for of_plane in colours.values()}) == len(colours)
    assert all(of_plane.max() > 100 for i, of_plane in colours.items() if i)
