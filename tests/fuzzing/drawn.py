"""Inputs from scratch, drawn by Hypothesis from what the program asks for; a failure is made as small as it goes."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import yaml
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.errors import HypothesisWarning
from hypothesis.strategies import SearchStrategy

from fuzzing import samples
from fuzzing.case import Case
from fuzzing.checks import gist
from fuzzing.mutations import ODD_VALUES
from slopecli.cli import PAIRINGS

COORDINATES = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 0.5, 100.0, 511.5, 1e-12, 1e9, 1e154, -1e308]),
    st.integers(-3, 3).map(float),
    st.floats(-2, 2, width=32),
    st.floats(0, 1024, width=32),
)
VALUES = st.one_of(
    st.sampled_from(ODD_VALUES), st.floats(), st.integers(), st.text(max_size=8), st.lists(st.floats(), max_size=9)
)
NAMES = (
    *(
        "width",
        "height",
        "w",
        "h",
        "fx",
        "fy",
        "cx",
        "cy",
        "K",
        "distortion",
        "model",
        "camera_matrix",
        "distortion_coefficients",
    ),
    *(
        "distortion_model",
        "image_width",
        "image_height",
        "D",
        "dist",
        "mtx",
        "fl_x",
        "fl_y",
        "frames",
        "k1",
        "k2",
        "camera_model",
    ),
    *(
        "intrinsics",
        "resolution",
        "projection_type",
        "focal",
        "c_x",
        "cameras",
        "cam0",
        "roi",
        "binning_x",
        "P",
        "R",
        "is_fisheye",
    ),
    *(
        "file_path",
        "size",
        "image_size",
        "fisheye_model",
        "name",
        "camera_name",
        "params",
        "focal_length",
        "principal_point",
        "skew",
    ),
)
MATRICES = st.sampled_from(([[800, 0, 511.5], [0, 800, 511.5], [0, 0, 1]], [800, 0, 511.5, 0, 800, 511.5, 0, 0, 1]))
OPTIONS = {
    "--intrinsics": st.lists(
        st.sampled_from(["0", "1", "24", "800", "511.5", "1e308", "-1", "nan", "1e-300", "x"]), min_size=3, max_size=5
    ).map(",".join),
    "--fov": st.sampled_from(["0", "1.047", "60", "179.99", "180", "-1", "nan", "1e-300", "x"]),
    "--up": st.lists(st.sampled_from(["0", "1", "-1", "1e308", "1e-320", "nan", "x"]), min_size=2, max_size=4).map(
        ",".join
    ),
    "--north": st.lists(st.sampled_from(["0", "1", "-1", "1e308", "1e-320"]), min_size=3, max_size=3).map(",".join),
    "--up-sigma": st.sampled_from(["0", "1", "89", "1e308", "-1", "nan"]),
    "--baseline": st.sampled_from(["0", "1e-320", "1", "1e308", "nan", "-1"]),
    "--altitude": st.sampled_from(["0", "1e-320", "1", "1e308", "nan", "-1"]),
    "--tolerance": st.sampled_from(["0", "15", "90", "180", "-1", "1e308"]),
    "--confidence": st.sampled_from(["0", "0.5", "0.99", "1", "0.9999999999999999", "nan"]),
    "--max-sigma": st.sampled_from(["0", "1e-300", "10", "60", "90"]),
    "--rotation-prior": st.lists(
        st.sampled_from(["0", "1", "0.1", "1e308", "1e-320", "360"]), min_size=4, max_size=5
    ).map(",".join),
    "--direction-prior": st.lists(
        st.sampled_from(["0", "1", "0.1", "1e308", "1e-320", "89"]), min_size=4, max_size=4
    ).map(",".join),
    "--noise": st.sampled_from(["0", "1e-320", "1e-12", "0.3", "1e308", "nan"]),
    "--seed": st.sampled_from(["0", "1", "2147483647", "2147483648", "-1"]),
    "--size": st.sampled_from(["1024x1024", "1x1", "999999x1", "0x0", "x"]),
}
WINDOWS = st.lists(
    st.sampled_from(["0", "1", "-1", "20", "95", "96", "97", "1000000000", "9" * 30]), min_size=4, max_size=4
).map(",".join)
GRIDS = st.sampled_from(["1x1", "3x3", "1x9999", "9999x9999", "0x1", "48x48", "96x1", "x"])


@st.composite
def cameras(draw: st.DrawFn) -> Case:
    """A camera file out of names that camera files have."""
    tree = draw(
        st.dictionaries(
            st.sampled_from(NAMES),
            st.one_of(VALUES, MATRICES, st.sampled_from([1024, 800, 511.5, "OPENCV", "brown"])),
            min_size=1,
            max_size=8,
        )
    )
    if draw(st.booleans()):
        tree = {"width": 1024, "height": 1024, **tree}
    if draw(st.booleans()):
        tree = {
            draw(st.sampled_from(NAMES)): draw(st.sampled_from([tree, [tree], [tree, tree], {"a": tree, "b": tree}]))
        }
    text = json.dumps(tree)
    if draw(st.booleans()):
        text = yaml.safe_dump(json.loads(text))
    files = {"camera.json": text.encode("utf-8", "surrogatepass"), "matches.csv": samples.pair(few=True)["matches.csv"]}
    return Case("drawn camera", ["solve", "matches.csv", "--camera", "camera.json", "--json"], files)


@st.composite
def tables(draw: st.DrawFn) -> Case:
    """A few correspondences of odd coordinates."""
    row = st.tuples(COORDINATES, COORDINATES, COORDINATES, COORDINATES, st.sampled_from([1, 1, 1, 2, 3, -1]))
    rows = draw(st.lists(row, min_size=3, max_size=16))
    if draw(st.booleans()):  # image 2 is image 1 moved
        dx, dy, scale = draw(COORDINATES), draw(COORDINATES), draw(st.sampled_from([1.0, 1.1, -1.0, 0.0]))
        rows = [(x, y, scale * x + dx, scale * y + dy, patch) for x, y, _, _, patch in rows]
    data = "x1,y1,x2,y2,patch\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    options = draw(
        st.sampled_from(
            [
                [],
                ["--solver", "ha"],
                ["--solver", "lh"],
                ["--noise", "0.3"],
                ["--merge-coplanar"],
                ["--pose", "pose.json"],
            ]
        )
    )
    camera = draw(st.sampled_from([[], ["--camera", "camera.json"], ["--intrinsics", "800,800,0,0"]]))
    files = {
        "matches.csv": data.encode(),
        "camera.json": samples.pair()["camera.json"],
        "pose.json": json.dumps(samples.POSE).encode(),
    }
    return Case("drawn table", ["solve", "matches.csv", *camera, *options, *draw(_ANSWER)], files)


@st.composite
def poses(draw: st.DrawFn) -> Case:
    """A pose of odd numbers."""
    number = st.one_of(st.sampled_from([0, 1, -1, 0.0, 1.0, 1e154, 1e-162, 1e308, None, True, "1"]), st.floats())
    rotation = draw(
        st.one_of(
            st.just(samples.POSE["R"]), st.lists(st.lists(number, min_size=3, max_size=3), min_size=3, max_size=3)
        )
    )
    tree: dict[str, Any] = {
        "R": rotation,
        draw(st.sampled_from(["T", "t", "baseline_cam1"])): draw(st.lists(number, min_size=2, max_size=4)),
    }
    if draw(st.booleans()):
        tree["t"] = draw(st.lists(number, min_size=3, max_size=3))
    files = {name: samples.pair(few=True)[name] for name in ("matches.csv", "camera.json")} | {
        "pose.json": json.dumps(tree).encode()
    }
    return Case(
        "drawn pose", ["solve", "matches.csv", "--camera", "camera.json", "--pose", "pose.json", *draw(_ANSWER)], files
    )


@st.composite
def command_lines(draw: st.DrawFn) -> Case:
    """Odd values of options."""
    names = draw(st.lists(st.sampled_from(list(OPTIONS)), max_size=4, unique=True))
    options = [part for name in names for part in (name, draw(OPTIONS[name]))]
    images, matches = ["image1.png", "image2.png"], ["matches.csv"]
    command = draw(
        st.sampled_from(
            [
                ["estimate", *images],
                ["solve", *matches],
                ["solve", *matches],
                ["solve", *matches],
                ["plan"],
                ["batch", ".", "--dry-run"],
            ]
        )
    )
    if command[0] in ("estimate", "plan") and "--noise" not in names:
        options += ["--window", draw(WINDOWS)] if draw(st.booleans()) else ["--grid", draw(GRIDS)]
    if command[0] == "batch":
        options += ["--pairing", draw(st.sampled_from([*PAIRINGS, "x.csv", "x"]))]
    if command[0] == "plan":
        options += ["--trajectory", "45", "--height", draw(st.sampled_from(["80", "1e-320", "1e308"]))]
    if not {"--intrinsics", "--fov"} & set(names):
        options += ["--camera", "camera.json"]
    answer = draw(_ANSWER) if command[0] != "batch" else []
    files = samples.pair() if draw(st.integers(0, 9)) == 9 else samples.pair(samples.SMALL, few=True)
    return Case("drawn options", [*command, *options, *answer], dict(files))


_ANSWER = st.sampled_from([["--json"], ["-o", "out"]])


def all_cases() -> SearchStrategy[Case]:
    """Every kind of drawn case."""
    return st.one_of(cameras(), tables(), tables(), poses(), command_lines())


class _Found(Exception):
    pass


_known: set[str] = set()  # causes of failures in this process


def drawn_failures(number: int, size: int, run: Callable[[Case], list[str]]) -> Iterator[tuple[Case, list[str]]]:
    """Draw `size` cases; the failures, of which one of a new cause is made as small as it goes."""
    failed: list[tuple[Case, list[str]]] = []

    @seed(number)
    @settings(
        max_examples=size,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
        report_multiple_bugs=False,
    )
    @given(all_cases())
    def one(case: Case) -> None:
        if found := run(case):
            failed.append((case, found))
            if gist(found) not in _known:
                raise _Found

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", HypothesisWarning)  # that a failure is large
            one()
        yield from failed
    except _Found:
        _known.add(gist(failed[-1][1]))
        yield failed[-1]
    except Exception as error:  # Hypothesis itself: a failure that does not come again
        if failed:
            yield failed[-1][0], [*failed[-1][1], f"{type(error).__name__}: {error}"]
        else:
            raise
