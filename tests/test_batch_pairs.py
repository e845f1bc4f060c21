"""Which images make pairs, what they are called, and which cameras they get; what is wrong is named."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopecli.batch import CameraChoice, FoundPairs, Pair, find_pairs, safe_name
from slopecli.errors import InputError
from slopecli.io import natural_key

SAMPLE = Path(__file__).resolve().parent.parent / "sample_data"
CAMERA = {"width": 320, "height": 240, "fx": 300, "fy": 300, "cx": 159.5, "cy": 119.5}
GIVEN = (CameraChoice(fov_deg=60.0), CameraChoice(fov_deg=60.0))


def fill(folder: Path, *names: str) -> str:
    """A folder with files of these names, empty ones but for cameras."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(CAMERA) if path.suffix == ".json" else "", encoding="utf-8")
    return str(folder)


def images_of(found: FoundPairs, folder: str | Path) -> list[tuple[str, str]]:
    return [(os.path.relpath(pair.image1, folder), os.path.relpath(pair.image2, folder)) for pair in found.pairs]


def names_of(found: FoundPairs) -> list[str]:
    return [pair.name for pair in found.pairs]


def cameras_of(pair: Pair, folder: str | Path) -> tuple[str, ...]:
    choices = (pair.camera1, pair.camera2)
    return tuple(os.path.relpath(choice.file, folder) for choice in choices if choice is not None and choice.file)


# ---- along the folder ----


def test_images_are_paired_in_the_order_people_count(tmp_path: Path) -> None:
    folder = fill(tmp_path, "img10.png", "img2.png", "IMG1.JPG", "img3.tiff")
    found = find_pairs(folder, cameras=GIVEN)
    assert images_of(found, folder) == [("IMG1.JPG", "img2.png"), ("img2.png", "img3.tiff"), ("img3.tiff", "img10.png")]
    assert names_of(found) == ["IMG1-img2", "img2-img3", "img3-img10"]
    assert found.pairs[0].camera1 == GIVEN[0]


@given(st.lists(st.text(st.characters(blacklist_characters="/\0"), min_size=1), unique=True))
def test_natural_order_is_an_order_of_all_names(names: list[str]) -> None:
    backwards = names[::-1]
    assert sorted(backwards, key=natural_key) == sorted(names, key=natural_key)


def test_stride_pairs_each_image_with_a_later_one(tmp_path: Path) -> None:
    folder = fill(tmp_path, *(f"{number}.png" for number in range(1, 6)))
    found = find_pairs(folder, "stride", stride=3, cameras=GIVEN)
    assert images_of(found, folder) == [("1.png", "4.png"), ("2.png", "5.png")]


def test_hidden_files_and_other_files_are_no_images(tmp_path: Path) -> None:
    folder = fill(tmp_path, "a.png", "b.png", "._a.png", "notes.txt", "c.png.part", "raw.dng")
    assert images_of(find_pairs(folder, cameras=GIVEN), folder) == [("a.png", "b.png")]


def test_a_folder_named_like_an_image_stays_in_the_list(tmp_path: Path) -> None:
    (tmp_path / "b.jpg").mkdir()
    folder = fill(tmp_path, "a.png", "c.png")
    assert images_of(find_pairs(folder, cameras=GIVEN), folder) == [("a.png", "b.jpg"), ("b.jpg", "c.png")]


def test_the_folder_of_results_is_no_input(tmp_path: Path) -> None:
    (tmp_path / "out.png").mkdir()
    folder = fill(tmp_path, "a.png", "b.png", "pair/1.png", "pair/2.png")
    output = str(tmp_path / "out.png")
    assert names_of(find_pairs(folder, cameras=GIVEN, output=output)) == ["a-b"]
    assert names_of(find_pairs(folder, "folders", cameras=GIVEN, output=output)) == ["pair"]
    with pytest.raises(InputError, match="cannot take the results too"):
        find_pairs(folder, cameras=GIVEN, output=os.path.join(folder, "."))


def test_results_deep_in_the_folder_are_no_pair(tmp_path: Path) -> None:
    folder = fill(tmp_path, "pair/1.png", "pair/2.png", "results/first/index.html")
    for output, names in (("results/first", ["pair"]), ("pair/out", ["pair", "results"])):
        found = find_pairs(folder, "folders", cameras=GIVEN, output=os.path.join(folder, output))
        assert names_of(found) == names
    with pytest.raises(InputError, match=r"pair: holds images of a pair.*another -o"):
        find_pairs(folder, "folders", cameras=GIVEN, output=os.path.join(folder, "pair"))


@pytest.mark.parametrize(
    ("names", "stride", "said"),
    [
        ([], 1, "holds no images; needed PNG"),
        (["a.png"], 1, "holds 1 image, needed at least 2"),
        (["a.png", "b.png", "c.png"], 3, "holds 3 images, needed at least 4"),
        (["one/a.png", "one/b.png"], 1, "--pairing folders"),
        (["DSC1.NEF", "DSC2.NEF"], 1, "DSC1.NEF and the like, which is not read; convert"),
    ],
)
def test_too_few_images_are_refused_with_what_to_do(names: list[str], stride: int, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        find_pairs(fill(tmp_path, *names), "stride", stride=stride, cameras=GIVEN)


@pytest.mark.parametrize(("name", "said"), [("missing", "no such folder"), ("file.png", "is a file, needed a folder")])
@pytest.mark.parametrize("pairing", ["consecutive", "folders", "list.csv"])
def test_a_folder_that_is_none_is_refused(name: str, said: str, pairing: str, tmp_path: Path) -> None:
    fill(tmp_path, "file.png")
    with pytest.raises(InputError, match=f"{name}: {said}"):
        find_pairs(str(tmp_path / name), pairing, cameras=GIVEN)


def test_a_pattern_chooses_images_of_a_folder_and_of_every_folder(tmp_path: Path) -> None:
    names = ("left_1.png", "left_2.png", "right_1.png", "right_2.png")
    folder = fill(tmp_path, *names, *(f"sub/{name}" for name in names), "other/a.png", "other/b.png")
    assert names_of(find_pairs(folder, pattern="left_*", cameras=GIVEN)) == ["left_1-left_2"]
    of_folders = {
        pair.name: pair.problem for pair in find_pairs(folder, "folders", pattern="left_?.png", cameras=GIVEN).pairs
    }
    assert of_folders["sub"] is None
    assert "none of its 2 images is called left_?.png; check --glob" in of_folders["other"]
    with pytest.raises(InputError, match=r"holds 1 image called left_1\*, needed at least 2"):
        find_pairs(folder, pattern="left_1*", cameras=GIVEN)


# ---- a folder per pair ----


def test_every_folder_is_a_pair_with_its_own_camera(tmp_path: Path) -> None:
    folder = fill(
        tmp_path, "b10/x.png", "b10/y.png", "b2/1.jpg", "b2/2.jpg", "b2/camera.json", ".git/a.png", "camera.json"
    )
    found = find_pairs(folder, "folders")
    assert names_of(found) == ["b2", "b10"]
    assert images_of(found, folder) == [("b2/1.jpg", "b2/2.jpg"), ("b10/x.png", "b10/y.png")]
    assert [cameras_of(pair, folder) for pair in found.pairs] == [("b2/camera.json",) * 2, ("camera.json",) * 2]


def test_folders_with_more_images_need_two_that_are_numbered(tmp_path: Path) -> None:
    folder = fill(
        tmp_path, "good/image1.png", "good/image2.png", "good/labels.png", "bad/a.png", "bad/b.png", "bad/c.png"
    )
    bad, good = find_pairs(folder, "folders", cameras=GIVEN).pairs
    assert good.problem is None
    assert Path(good.image2).name == "image2.png"
    assert "bad: holds 3 images, needed two" in str(bad.problem)


def test_a_folder_with_two_cameras_has_one_for_each_image(tmp_path: Path) -> None:
    folder = fill(tmp_path, "p/1.png", "p/2.png", "p/camera1.json", "p/camera2.json")
    (pair,) = find_pairs(folder, "folders").pairs
    assert cameras_of(pair, folder) == ("p/camera1.json", "p/camera2.json")


def test_sample_data_is_a_folder_of_pairs() -> None:
    found = find_pairs(str(SAMPLE), "folders")
    assert names_of(found) == ["descent", "urban"]
    assert not any(pair.problem for pair in found.pairs)


# ---- a list of pairs ----


def listed(folder: Path, text: str | bytes, **options: object) -> FoundPairs:
    file = folder / "pairs.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return find_pairs(str(folder), str(file), **{"cameras": GIVEN, **options})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text",
    [
        "b.png,a.png\nsub/c.png,a.png\n",
        "image1,image2\nb.png,a.png\n\nsub/c.png,a.png",
        "id, Image2, IMAGE1\n1,a.png,b.png\n2, a.png, sub/c.png\n",
        "b.png;a.png\r\nsub/c.png;a.png\r\n",
        '\ufeffb.png\ta.png\n"sub/c.png"\ta.png\n',
    ],
)
def test_pairs_are_read_from_a_table_in_its_order(text: str, tmp_path: Path) -> None:
    found = listed(tmp_path, text)
    assert images_of(found, tmp_path) == [("b.png", "a.png"), ("sub/c.png", "a.png")]
    assert names_of(found) == ["b-a", "sub_c-a"]


def test_rows_may_name_their_cameras(tmp_path: Path) -> None:
    text = "a.png,b.png,left.json,right.yaml#cam1\nb.png,c.png,left.json\nc.png,d.png,,right.json\nd.png,e.png\n"
    pairs = listed(tmp_path, text).pairs
    assert [cameras_of(pair, tmp_path) for pair in pairs] == [
        ("left.json", "right.yaml#cam1"),
        ("left.json", "left.json"),
        ("right.json",),
        (),
    ]
    assert (pairs[2].camera1, pairs[3].camera2) == GIVEN


def test_a_pair_listed_twice_is_answered_once_and_said(tmp_path: Path) -> None:
    found = listed(tmp_path, "a.png,b.png\nb.png,c.png\na.png,b.png\n")
    assert names_of(found) == ["a-b", "b-c"]
    assert found.notes == [f"{tmp_path / 'pairs.csv'}: line 3 is the pair of line 1 again, and is left out"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "holds no pairs"),
        ("image1,image2\n", "holds no pairs"),
        ("a.png,b.png\nc.png\n", "line 2 names one image, needed two"),
        ("a.png,b.png\n,c.png\n", "line 2 names one image"),
        ("a,b,c,d,e\n", "line 1 has 5 cells"),
        ('a.png,"b.png\n', "is not CSV"),
        (b"\xff\xfea", "is not CSV text"),
        (b"a.png\0,b.png", "is not CSV text"),
    ],
)
def test_a_list_that_is_none_is_refused_by_its_line(text: str | bytes, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"pairs.csv: .*{said}"):
        listed(tmp_path, text)


def test_a_list_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.csv: no such list of pairs"):
        find_pairs(str(tmp_path), str(tmp_path / "none.csv"), cameras=GIVEN)


# ---- cameras beside the images ----


@pytest.mark.parametrize(
    "name", ["camera.json", "cameras.txt", "calib.yml", "calibration_left.xml", "camchain-x.yaml", "Intrinsics.json"]
)
def test_a_camera_beside_the_images_is_used_and_said(name: str, tmp_path: Path) -> None:
    folder = fill(tmp_path, "a.png", "b.png", "poses.json", "notes.txt")
    shutil.copy(SAMPLE / "descent" / "camera.json", tmp_path / name)  # formats are told apart by content
    found = find_pairs(folder)
    assert cameras_of(found.pairs[0], folder) == (name, name)
    assert found.notes == [f"camera: {tmp_path / name}, found beside the images"]


def test_each_image_takes_the_camera_of_its_own_folder(tmp_path: Path) -> None:
    fill(tmp_path, "left/a.png", "right/a.png", "left/camera.json", "right/camera.json")
    (pair,) = listed(tmp_path, "left/a.png,right/a.png\n", cameras=None).pairs
    assert cameras_of(pair, tmp_path) == ("left/camera.json", "right/camera.json")


def test_cameras_given_are_not_looked_for(tmp_path: Path) -> None:
    found = find_pairs(fill(tmp_path, "a.png", "b.png", "camera.json"), cameras=GIVEN)
    assert (found.pairs[0].camera1, found.notes) == (GIVEN[0], [])


def test_many_cameras_are_said_in_one_line(tmp_path: Path) -> None:
    names = [f"p{number}/{name}" for number in range(9) for name in ("a.png", "b.png", "camera.json")]
    (note,) = find_pairs(fill(tmp_path, *names), "folders").notes
    assert note.startswith("camera: 9 files found beside the images")


def test_cameras_of_colmap_in_two_forms_are_one(tmp_path: Path) -> None:
    folder = fill(tmp_path, "a.png", "b.png", "cameras.bin")
    shutil.copy(SAMPLE / "descent" / "camera.json", tmp_path / "cameras.txt")
    assert cameras_of(find_pairs(folder).pairs[0], folder) == ("cameras.txt", "cameras.txt")


def test_two_cameras_to_choose_from_are_refused(tmp_path: Path) -> None:
    folder = fill(tmp_path, "a.png", "b.png", "camera.json", "calib.json")
    with pytest.raises(InputError, match=r"holds calib\.json and camera\.json; say which"):
        find_pairs(folder)


def test_no_camera_anywhere_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no camera; give --camera FILE"):
        find_pairs(fill(tmp_path, "a.png", "b.png"))


def test_one_pair_without_a_camera_does_not_stop_the_others(tmp_path: Path) -> None:
    folder = fill(tmp_path, "p1/a.png", "p1/b.png", "p2/a.png", "p2/b.png", "p2/camera.json")
    first, second = find_pairs(folder, "folders").pairs
    assert "no camera" in str(first.problem)
    assert second.problem is None


def test_a_camera_for_all_that_cannot_be_read_is_refused_at_once(tmp_path: Path) -> None:
    folder = fill(tmp_path, "a.png", "b.png")
    bad = tmp_path / "camera.json"
    bad.write_text('{"fx": 1', encoding="utf-8")
    with pytest.raises(InputError, match=r"camera\.json: is damaged JSON"):
        find_pairs(folder)
    with pytest.raises(InputError, match="no such camera file"):
        find_pairs(folder, cameras=(CameraChoice(file="gone.json"),) * 2)


def test_a_camera_without_a_size_is_tried_with_that_of_an_image(tmp_path: Path) -> None:
    folder = fill(tmp_path, "0.png")  # no image at all: it is passed over
    for name in ("1.png", "2.png"):
        shutil.copy(SAMPLE / "descent" / "image1.png", tmp_path / name)
    (tmp_path / "camera.json").write_text(json.dumps({"fx": 700, "fy": 700, "cx": 400, "cy": 400}), encoding="utf-8")
    assert len(find_pairs(folder).pairs) == 2


# ---- names ----


def test_names_are_unique_whatever_the_case_and_leave_those_of_the_batch(tmp_path: Path) -> None:
    folder = fill(tmp_path, "a.png", "A.png", "a.jpg", "a.tif")
    names = names_of(find_pairs(folder, cameras=GIVEN))
    assert len({name.casefold() for name in names}) == 3
    folder = fill(tmp_path / "folders", "index.html/1.png", "index.html/2.png", "b/1.png", "b/2.png")
    assert names_of(find_pairs(folder, "folders", cameras=GIVEN)) == ["b", "index.html_2"]


@given(st.text(st.characters(min_codepoint=0, max_codepoint=0x10FFFF, blacklist_categories=()), max_size=300))
def test_any_text_becomes_a_name_a_file_system_takes(text: str) -> None:
    name = safe_name(text)
    assert name == safe_name(name)
    assert 0 < len(os.fsencode(name)) <= 120
    assert not name.startswith(".")
    assert not set(name) & set('/\\:*?"<>|\0\n')


def test_long_names_that_differ_stay_apart() -> None:
    assert safe_name("x" * 300) != safe_name("x" * 301)
