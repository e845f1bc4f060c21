"""The kinds of inputs: each makes a case of a generator of random numbers."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

from fuzzing import samples
from fuzzing.case import FIFO, FOLDER, LINK, Case, Content
from fuzzing.checks import run_command, tree_of
from fuzzing.image_mutations import change_structure, odd_pixels
from fuzzing.match_files import match_file
from fuzzing.metadata_mutations import odd_photograph
from fuzzing.mutations import (
    HOSTILE,
    ODD_TEXTS,
    ODD_VALUES,
    change_bytes,
    change_encoding,
    change_text,
    change_tree,
    changed,
    keys_of,
    parsed,
    written,
)

IMAGES, MATCHES = ("image1.png", "image2.png"), "matches.csv"
QUICK = ["--grid", "1x1"]
WHOLE = (
    0.1  # of inputs have all correspondences, and images large enough for an answer; others take a fifth of the time
)


def make_case(seed: int, number: int, kinds: list[str] | None = None) -> Case:
    """The case of that number, the same at every call; of one of the `kinds` if any are given."""
    rng = Random(f"{seed} {number}")
    names = kinds or list(KINDS)
    name = rng.choices(names, [KINDS[name][0] for name in names])[0]
    return KINDS[name][1](rng)


def _pair(rng: Random, *names: str) -> dict[str, Content]:
    files = samples.pair() if rng.random() < WHOLE else samples.pair(samples.SMALL, few=True)
    return {name: files[name] for name in names}


def _output(rng: Random) -> list[str]:
    return ["-o", "out"] if rng.random() < 0.5 else ["--json"]


# ---- cameras ----


@cache
def _vocabulary() -> tuple[str, ...]:
    return tuple(sorted(set().union(*(keys_of(parsed(text)) for text in samples.camera_texts()))))


def camera_content(rng: Random) -> bytes:
    """A camera file, changed by its structure, as text or as bytes."""
    if rng.random() < 0.04:
        return rng.choice(samples.camera_bombs())
    if rng.random() < 0.15:
        return _binary_camera(rng)
    text = rng.choice(samples.camera_texts())
    if rng.random() < 0.5 and (tree := parsed(text)) is not None:
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            tree = change_tree(rng, tree, _vocabulary())
        data = written(rng, tree)
        return data if rng.random() < 0.8 else change_text(rng, data)
    ways = (change_text, change_text, change_text, change_text, change_encoding, change_bytes, _spliced)
    return changed(rng, text.encode("utf-8", "surrogateescape"), *ways)


def _spliced(rng: Random, data: bytes) -> bytes:
    other = rng.choice(samples.camera_texts()).encode()
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def _binary_camera(rng: Random) -> bytes:
    if rng.random() < 0.4:
        import numpy as np

        names = rng.choice(("mtx", "K", "dist", "M1", "width", "image_size", "x", "a/b", HOSTILE[2]))
        value = rng.choice(
            (*ODD_VALUES[:22], [], np.zeros((3, 3)), np.eye(3, dtype=complex), np.array(["x"]), np.zeros((0, 3)))
        )
        try:
            with np.errstate(all="ignore"):
                return samples.numpy_archive(**{names: np.asarray(value)})
        except (ValueError, OverflowError):
            pass
    return changed(rng, rng.choice(samples.camera_binaries()), change_bytes)


def camera(rng: Random) -> Case:
    """A changed camera file, for the images, for correspondences or for a plan."""
    name = rng.choice(
        ("camera.json", "camera.yaml", "cameras.txt", "camera.xml", "camera.npz", "K.npy", "a.cam", "c.mat")
    )
    files: dict[str, Content] = {name: camera_content(rng)}
    picked = name + rng.choice(("", "", "", "#1", "#cam0", "#0", "#left", "#x", f"#{rng.choice(HOSTILE[:5])}"))
    way = rng.random()
    if way < 0.1:
        return Case(
            "camera", ["estimate", *IMAGES, "--camera", picked, *QUICK, *_output(rng)], {**_pair(rng, *IMAGES), **files}
        )
    if way < 0.25:
        given = rng.choice(([], [], ["--size", "1024x768"], ["--image", IMAGES[0]]))
        output = rng.choice(([], ["-o", "out"], ["--json"]))
        return Case("camera", ["camera", "show", picked, *given, *output], {**_pair(rng, IMAGES[0]), **files})
    if way < 0.35:
        flight = ["--trajectory", "45", "--height", "80", "--baseline", "16"]
        return Case("camera", ["plan", "--camera", picked, *flight, *_output(rng)], files)
    return Case("camera", ["solve", MATCHES, "--camera", picked, *_output(rng)], {**_pair(rng, MATCHES), **files})


# ---- images ----


def image(rng: Random) -> Case:
    """A changed image, or one of odd pixels, as the first or the second of a pair."""
    side = samples.SIDE if rng.random() < WHOLE else samples.SMALL
    if rng.random() < 0.1:
        name, data = "odd.png", odd_pixels(rng)
    else:
        name, data = rng.choice(list(samples.images(side).items()))
        data = changed(rng, data, change_structure, change_structure, change_bytes) if rng.random() < 0.95 else data
    if rng.random() < 0.05:
        name = f"image{rng.choice(('.dng', '', '.heic', '.PNG', '.csv'))}"
    if rng.random() < 0.1:  # what it states of its camera
        given = rng.choice(([name], [name, "--json"], [name, "-o", "out"], ["camera.json", "--image", name]))
        return Case("image", ["camera", "show", *given], {**_pair(rng, "camera.json"), name: data})
    names = [name, IMAGES[1]] if rng.random() < 0.7 else [IMAGES[0], name]
    if rng.random() < 0.05:
        names = [name, name]
    command = ["segment"] if rng.random() < 0.05 else ["estimate", *QUICK]
    given = rng.choice((["--camera", "camera.json"], ["--fov", "60"], ["--intrinsics", "90,90,47.5,47.5"]))
    good = {one: samples.pair(side)[one] for one in ("camera.json", *(set(names) & set(IMAGES)))}
    files: dict[str, Content] = {**good, name: data}
    return Case("image", [command[0], *names, *command[1:], *given, *_output(rng)], files)


# ---- metadata ----


def metadata(rng: Random) -> Case:
    """Photographs with odd EXIF and XMP: what they state, alone or as options of an estimate."""
    photographs: dict[str, Content] = {f"view{number}.jpg": odd_photograph(rng, number) for number in (1, 2)}
    if rng.random() < 0.7:
        return Case("metadata", ["camera", "show", "view1.jpg"], photographs)
    words = rng.sample(("--up", "--north", rng.choice(("--baseline", "--altitude"))), rng.randrange(4))
    asked = [part for word in words for part in (word, "exif")]
    more: list[list[str]] = [[], [], ["--pitch", "-80"], ["--roll", "90"], ["--yaw", "30"], ["--scale-sigma", "20"]]
    camera = rng.choice((["--metadata"], ["--metadata"], ["--camera", "exif"], ["--fov", "60"]))
    given = [*asked, *camera, *rng.choice(more), *rng.choice(more)]
    return Case("metadata", ["estimate", *photographs, *QUICK, *given, *_output(rng)], photographs)


# ---- correspondences and poses ----


def matches(rng: Random) -> Case:
    """A changed table of correspondences."""
    data = samples.pair(few=rng.random() > WHOLE)[MATCHES]
    if rng.random() < 0.5:
        data = _changed_table(rng, data)
    else:
        data = changed(rng, data, change_text, change_encoding, change_bytes)
    given = rng.choice(
        ([], ["--camera", "camera.json"], ["--camera", "camera.json"], ["--intrinsics", "800,800,511.5,511.5"])
    )
    options = rng.choice(([], [], ["--noise", "0.3"], ["--solver", "ha"], ["--solver", "lh"], ["--merge-coplanar"]))
    return Case(
        "matches", ["solve", MATCHES, *given, *options, *_output(rng)], {**_pair(rng, "camera.json"), MATCHES: data}
    )


def _changed_table(rng: Random, data: bytes) -> bytes:
    rows = [line.split(",") for line in data.decode().splitlines()]
    header, rows = rows[0], rows[1:]
    column = rng.randrange(len(header))
    way = rng.randrange(13)
    if way == 0:
        for _ in range(rng.choice((1, 5, 50))):
            rng.choice(rows)[rng.randrange(len(header))] = rng.choice(ODD_TEXTS)
    elif way == 1:
        value = rng.choice(("0", "1", "5.5", "-1", "1e308", "1e-300", rows[0][column]))
        rows = [[*row[:column], value, *row[column + 1 :]] for row in rows]
    elif way == 2:
        rows = [rows[0]] * rng.choice((1, 2, 5, 6, 8, 50))
    elif way == 3:
        rows = rng.sample(rows, min(len(rows), rng.choice((0, 1, 3, 4, 5, 6, 7, 8, 9, 12, 20))))
    elif way == 4:
        factor = rng.choice((1e-300, 1e-12, 1e-3, 1e3, 1e12, 1e150, 1e300, -1, 0))
        rows = [[*(repr(float(cell) * factor) for cell in row[:4]), row[4]] for row in rows]
    elif way == 5:
        patches = rng.choice((["0"], ["-1"], ["1", "2"], [str(k) for k in range(300)], ["2147483647"], ["-1", "7"]))
        rows = [[*row[:4], rng.choice(patches)] for row in rows]
    elif way == 6:
        names = rng.choice(
            (
                ["x1", "y1", "x2", "y2", "sigma"],
                ["a", "b"],
                ["x1", "x1", "y1", "x2", "y2"],
                [" X1", "Y1 ", "x2", "y2", ""],
            )
        )
        header = names
    elif way == 7:
        rng.shuffle(rows)
        rows += rows * rng.choice((0, 1))
    elif way == 8:
        moving = [repr(float(cell) + rng.choice((0, 1e6, -1e9))) for cell in rows[0][:2]]
        rows = [[*row[:2], *(moving if rng.random() < 0.5 else row[:2]), row[4]] for row in rows]
    elif way == 9:
        rows = [[*row[:2], *row[:2], row[4]] for row in rows]
    elif way == 10:
        rows = [
            [*map(str, (rng.choice((0, 1, 2, 500)) for _ in range(4))), row[4]]
            for row in rows[: rng.choice((6, 12, 60))]
        ]
    elif way == 11:
        header, rows = [*header, "sigma"], [[*row, rng.choice(("1", "1e-300", "1e300", "0.1", "1e3"))] for row in rows]
    else:
        rows = [[f'"{cell}"' for cell in row] + [rng.choice(("", "extra", '"'))] for row in rows]
    mark = rng.choice((",", ",", ",", ";", "\t", " ", "|"))
    return "\n".join(map(mark.join, [header, *rows])).encode()


def pose(rng: Random) -> Case:
    """A changed pose, beside the correspondences that it may belong to."""
    tree: Any = rng.choice(
        (
            samples.POSE,
            samples.OPENCV_POSE,
            {
                "motion": {"rotation_cam2_from_cam1": samples.POSE["R"], "baseline_cam1": [0, 0, 1]},
                "scale": {"unit": "m"},
            },
        )
    )
    data = json.dumps(tree, indent=1).encode()
    if rng.random() < 0.7:
        for _ in range(rng.choice((1, 1, 2))):
            tree = change_tree(
                rng, tree, ("R", "T", "t", "motion", "scale", "unit", "baseline_cam1", "rotation_cam2_from_cam1")
            )
        data = written(rng, tree)
    else:
        data = changed(rng, data, change_text, change_encoding, change_bytes)
    options = rng.choice(([], [], ["--pose-sigma", "0.5"]))
    arguments = ["solve", MATCHES, "--camera", "camera.json", "--pose", "pose.json", *options, *_output(rng)]
    return Case("pose", arguments, {**_pair(rng, "camera.json", MATCHES), "pose.json": data})


# ---- batches ----


def pair_list(rng: Random) -> Case:
    """A list of pairs with odd rows and paths."""
    rows = [
        ["view1.png", "view2.png"],
        ["view2.png", "view1.png", "camera.json"],
        ["view1.png", "./view2.png", "camera.json", "camera.json"],
    ]
    odd = (
        *HOSTILE,
        *ODD_TEXTS,
        "view1.png",
        "..",
        ".",
        "/",
        "//",
        "/dev/null",
        "/dev/zero",
        "pipe.png",
        "folder",
        "loop",
        "gone.png",
        "camera.json#x",
        " view1.png",
        "-o",
    )
    for _ in range(rng.choice((1, 2, 3))):
        row = rng.choice(rows)
        row[rng.randrange(len(row))] = rng.choice(odd)
        if rng.random() < 0.3:
            rows.append([rng.choice(odd) for _ in range(rng.randrange(1, 7))])
    if rng.random() < 0.3:
        rows.insert(
            0,
            rng.choice(
                (
                    ["image1", "image2", "camera1", "camera2"],
                    ["image2", "image1"],
                    ["IMAGE1", "image1", "image2"],
                    ["a", "b"],
                )
            ),
        )
    text = io.StringIO()
    quoting = rng.choice((csv.QUOTE_MINIMAL, csv.QUOTE_ALL))
    csv.writer(
        text, delimiter=rng.choice(",,;\t|"), lineterminator=rng.choice(("\n", "\r\n", "\r")), quoting=quoting
    ).writerows(rows)
    data = text.getvalue().encode("utf-8", "surrogateescape")
    if rng.random() < 0.3:
        data = changed(rng, data, change_text, change_encoding, change_bytes)
    options = rng.choice((["--camera", "views/camera.json"], [], ["--fov", "60"]))
    how = ["--dry-run"] if rng.random() < 0.85 else ["-o", "out", *QUICK]
    special: dict[str, Content] = {"views/pipe.png": FIFO, "views/folder": FOLDER, "views/loop": f"{LINK}loop"}
    files = {**_views(rng.random() > WHOLE), **special, "pairs.csv": data}
    return Case("list", ["batch", "views", "--pairing", "pairs.csv", *options, *how], files)


def folder(rng: Random) -> Case:
    """A folder with odd entries, all of whose pairs are to be tried."""
    files = _views(rng.random() > WHOLE)
    names = [f"{name.replace('/', '')[:60]}.png" for name in HOSTILE] + [
        ".png",
        "view1.PNG",
        "view3.jpg",
        "sub/view1.png",
        "sub/view2.png",
        "image1.png",
    ]
    contents: list[Content] = [
        FIFO,
        FOLDER,
        f"{LINK}nowhere",
        f"{LINK}.",
        f"{LINK}view1.png",
        b"",
        b"x",
        files["views/view1.png"],
    ]
    for _ in range(rng.choice((1, 1, 2, 3))):
        files[f"views/{rng.choice(names)}"] = rng.choice(contents)
    if rng.random() < 0.3:
        files[f"views/{rng.choice(('camera.json', 'calib.yaml', 'cameras.txt'))}"] = rng.choice(
            (camera_content(rng), FIFO, FOLDER)
        )
    pairing = rng.choice(([], [], ["--pairing", "folders"], ["--pairing", "stride", "--stride", "2"]))
    options = rng.choice((["--camera", "views/camera.json"], [], ["--intrinsics", "90,90,47.5,47.5"]))
    how = ["--dry-run"] if rng.random() < 0.6 else ["-o", "out", *QUICK]
    files = {
        name: content
        for name, content in files.items()
        if not any(str(parent) in files and files[str(parent)] != FOLDER for parent in Path(name).parents)
    }
    return Case("folder", ["batch", "views", *pairing, *options, *how], files)


def record(rng: Random) -> Case:
    """A finished batch whose record or files were changed: it comes to the files that an undisturbed one has."""
    arguments, views, undisturbed = _finished_batch(small=rng.random() > WHOLE)
    files: dict[str, Content] = {**views, **{f"out/{name}": content for name, content in undisturbed.items()}}
    changeable = [name for name in files if name.startswith("out/view")]
    chosen = [name for name in changeable if name.endswith("pair.json")] if rng.random() < 0.8 else changeable
    name = rng.choice(chosen)
    data = files[name]
    assert isinstance(data, bytes)
    if name.endswith(".json") and rng.random() < 0.8:
        tree = json.loads(data)
        for _ in range(rng.choice((1, 1, 2))):
            tree = change_tree(rng, tree, tuple(tree) if isinstance(tree, dict) else ("name",))
        data = json.dumps(tree, indent=2).encode()
    else:
        data = changed(rng, data, change_bytes, change_text)
    files[name] = data if rng.random() < 0.95 else FIFO
    return Case("record", arguments, files, {f"out/{name}": content for name, content in undisturbed.items()})


def _views(small: bool) -> dict[str, Content]:
    pair = samples.pair(samples.SMALL if small else samples.SIDE)
    return {
        "views/view1.png": pair["image1.png"],
        "views/view2.png": pair["image2.png"],
        "views/camera.json": pair["camera.json"],
    }


@cache
def _finished_batch(small: bool) -> tuple[list[str], dict[str, Content], dict[str, bytes]]:
    """The command, its folder of images and its outputs; small images have no answer."""
    arguments, views = ["batch", "views", "-o", "out", *QUICK, "--no-ply", "-q"], _views(small)
    case = Case("record", arguments, views)
    with TemporaryDirectory() as name:
        case.lay_out(Path(name, "case"))
        done = run_command(arguments, Path(name, "case"))
        assert done.returncode == (4 if small else 0), done.stderr
        return arguments, views, tree_of(Path(name, "case", "out"))


def truth(rng: Random) -> Case:
    """An answer and known ground, one of which was changed."""
    answer = _finished_answer()
    name = rng.choice(("depth.npy", "depth.npz", "depth.pfm", "depth.png", "cloud.ply", "cloud.npy"))
    files: dict[str, Content] = {"answer/slopes.json": answer, name: samples.truths()[name]}
    changed_name = rng.choice((name, name, "answer/slopes.json"))
    data = files[changed_name]
    assert isinstance(data, bytes)
    if changed_name.endswith(".json") and rng.random() < 0.8:
        tree = json.loads(data)
        for _ in range(rng.choice((1, 1, 2, 4))):
            tree = change_tree(rng, tree, tuple(tree) if isinstance(tree, dict) else ("name",))
        data = json.dumps(tree).encode()
    else:
        data = changed(rng, data, change_bytes, change_bytes, change_text)
    files[changed_name] = data
    option = "--points" if name.startswith("cloud") else "--disparity" if rng.random() < 0.3 else "--depth"
    baseline = (
        ["--baseline", rng.choice(("1", "0.2", "0", "1e300", "nan", "x", "-3"))] if option == "--disparity" else []
    )
    output = ["-o", "out"] if rng.random() < 0.1 else ["--json"]  # its figure takes half a second
    return Case("truth", ["validate", "answer", option, name, *baseline, *output], files)


@cache
def _finished_answer() -> bytes:
    """slopes.json of the pair."""
    with TemporaryDirectory() as folder:
        files: dict[str, Content] = {name: samples.pair()[name] for name in (*IMAGES, "camera.json")}
        case = Case("answer", ["estimate", *IMAGES, "--camera", "camera.json", *QUICK, "-o", "out"], files)
        case.lay_out(Path(folder))
        run_command(case.arguments, Path(folder))
        return (Path(folder) / "out" / "slopes.json").read_bytes()


KINDS: dict[str, tuple[float, Callable[[Random], Case]]] = {
    "camera": (45, camera),
    "image": (20, image),
    "metadata": (10, metadata),
    "matches": (15, matches),
    "match_file": (8, match_file),
    "pose": (6, pose),
    "list": (8, pair_list),
    "folder": (4, folder),
    "record": (1.5, record),
    "truth": (6, truth),
}
