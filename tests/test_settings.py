"""`--config`: options from a TOML file, and `slopemap demo`, which needs no file at all."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from command import Done, slopemap

PLAN = ("plan", "--json")


def settings(folder: Path, text: str) -> str:
    path = folder / "slopemap.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_settings_are_as_good_as_the_command_line(tmp_path: Path) -> None:
    path = settings(
        tmp_path,
        'fov = 60\nsize = "640x480"\nnoise = 0.2\n[plan]\ndirection = [1, 0, 0]\nheight = 80\nbaseline = 16\n'
        "ground_slope = 5\n[map]\nfootprint = 64\n",
    )
    by_file = slopemap(*PLAN, "--config", path)
    by_hand = slopemap(
        *PLAN, "--fov", "60", "--size", "640x480", "--noise", "0.2", "--direction", "1,0,0", "--height", "80",
        "--baseline", "16", "--ground-slope", "5",
    )  # fmt: skip
    assert by_file.returncode == 0, by_file.stderr
    assert by_file.stdout == by_hand.stdout


def test_the_command_line_comes_first_then_the_table_then_what_is_for_all(tmp_path: Path) -> None:
    path = settings(tmp_path, "fov = 40\nheight = 80\nbaseline = 1\n[plan]\nfov = 60\nbaseline = 8\n")
    given = ("--size", "640x480", "--direction", "1,0,0", "--baseline", "16")
    found = json.loads(slopemap(*PLAN, *given, "--config", path).stdout)
    wanted = json.loads(slopemap(*PLAN, *given, "--fov", "60", "--height", "80").stdout)
    assert found == wanted


def test_flags_and_several_values(tmp_path: Path) -> None:
    path = settings(
        tmp_path,
        'fov = 60\nsize = "640x480"\nheight = 80\nbaseline = 16\n[plan]\ndirection = "1,0,0"\njson = true\n'
        'window = ["10,10,100,100", "200,200,100,100"]\n',
    )
    done = slopemap("plan", "--config", path)
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)["windows"]) == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("foof = 3\n", "--foof"),
        ("[plan]\nfootprint_m = 3\n", "--footprint-m"),
        ("[plane]\nfov = 3\n", "'plane'"),
        ("fov = [[1]]\n", "fov"),
        ("fov = 1979-05-27\n", "fov"),
        ("fov 3\n", "no TOML"),
        ("\x00", "no TOML"),
    ],
)
def test_what_is_no_setting_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    done = slopemap(*PLAN, "--config", settings(tmp_path, text))
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1), done.stderr
    assert said in done.stderr
    assert "fault of slopemap" not in done.stderr


def test_a_value_out_of_range_is_refused_as_on_the_command_line(tmp_path: Path) -> None:
    done = slopemap(*PLAN, "--config", settings(tmp_path, "fov = 400\n"))
    assert done.returncode == 2
    assert "--fov" in done.stderr


def test_a_value_that_is_refused_is_told_with_its_file(tmp_path: Path) -> None:
    file = tmp_path / "slopemap.toml"
    file.write_text('tolerance = "steep"\n')
    done = slopemap("estimate", "a.png", "b.png", "--camera", "c.json", "-o", "out", "--config", str(file))
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == (
        f"Error: Invalid value for '--tolerance': 'steep' is not a valid number. It stands in {file}."
    )


def test_a_settings_file_that_is_not_there(tmp_path: Path) -> None:
    done = slopemap(*PLAN, "--config", str(tmp_path / "no.toml"))
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)


def test_options_before_the_command_are_told_to_follow_it() -> None:
    done = slopemap("--config", "slopemap.toml", "plan")
    assert (done.returncode, done.stdout) == (2, "")
    assert "Options of a command follow it: slopemap COMMAND --config" in done.stderr


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Done, Path]:
    """What the command said, and the folder it ran in."""
    folder = tmp_path_factory.mktemp("demo")
    return slopemap("demo", cwd=folder), folder


def test_demo_answers_from_what_the_package_carries(demo: tuple[Done, Path]) -> None:
    done, folder = demo[0], demo[1] / "slopemap_demo"
    assert done.returncode == 0, done.stderr
    files = {path.name for path in folder.iterdir()}
    assert {"image1.jpg", "image2.jpg", "camera.json", "map.png", "slopes.json"} <= files
    answer = json.loads((folder / "slopes.json").read_text(encoding="utf-8"))
    assert answer["scale"]["unit"] == "m"
    assert len(answer["sites"]) >= 3
    assert cv2.imread(str(folder / "map.png")).std() > 20
    assert "next: look at" in done.stderr
    (wrote,) = (line for line in done.stderr.splitlines() if line.startswith("wrote "))
    assert {Path(name).name for name in wrote.removeprefix("wrote ").split(", ")} == files


def test_the_slopes_of_the_demo_are_those_of_the_depth_it_carries(demo: tuple[Done, Path]) -> None:
    depth = ("--depth", "slopemap_demo/depth.png", "--factor", "0.001")
    done = slopemap("validate", "slopemap_demo", *depth, "-o", "check", "--json", cwd=demo[1])
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found["planes"]) == 9
    assert max(abs(one["difference_deg"]) for one in found["planes"]) < 0.5
    assert found["scale"] == pytest.approx(1.0, abs=0.005)
    assert (demo[1] / "check" / "validation.png").exists()
    page = (Path(__file__).resolve().parent.parent / "docs" / "validate.md").read_text(encoding="utf-8")
    told = re.findall(r"^ *(\d)  +([\d.]+) ± [\d.]+° +([\d.]+)° ", page, re.MULTILINE)
    assert [int(number) for number, *_ in told] == [one["id"] for one in found["planes"]]
    for at, name in ((1, "slope_deg"), (2, "true_slope_deg")):
        assert [float(row[at]) for row in told] == pytest.approx([one[name] for one in found["planes"]], abs=0.2)


@pytest.mark.slow
def test_demo_of_a_town_has_roofs_walls_and_a_page(tmp_path: Path) -> None:
    done = slopemap("demo", "--town", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    files = {path.name for path in (tmp_path / "slopemap_town").iterdir()}
    assert {"image1.jpg", "camera.json", "overlay.png", "patches.glb", "report.html", "slopes.json"} <= files
    kinds = [line.split()[1] for line in done.stdout.splitlines()[1:]]
    assert kinds.count("roof") >= 5
    assert kinds.count("wall") >= 3
    assert "report.html" in done.stderr.splitlines()[-2]


@pytest.mark.parametrize(("small_name", "full_name"), [("descent", "descent"), ("town", "urban")])
def test_the_pair_of_the_demo_is_that_of_the_sample(small_name: str, full_name: str) -> None:
    root = Path(__file__).resolve().parent.parent
    for number in (1, 2):
        small, full = (
            cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(float)
            for path in (
                root / "slopecli" / "sample" / small_name / f"image{number}.jpg",
                root / "sample_data" / full_name / f"image{number}.png",
            )
        )
        as_large = cv2.resize(full, small.shape[::-1], interpolation=cv2.INTER_AREA)
        assert np.abs(small - as_large).mean() < 4.0
