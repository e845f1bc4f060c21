"""`import slopecli`: the names a user needs, at once, and what they stand for only when it is used."""

from __future__ import annotations

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import slopecli

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("name", slopecli.__all__)
def test_a_public_name_is_there_and_says_what_it_is(name: str) -> None:
    assert name in dir(slopecli)
    value = getattr(slopecli, name)
    assert value.__name__ == name
    assert len((inspect.getdoc(value) or "").split()) > 4
    assert not (inspect.getdoc(value) or "").startswith(f"{name}("), "only what dataclass writes itself"


def test_names_that_others_rely_on_are_public() -> None:
    stable = "Camera Image Options Report load_camera load_image estimate solve_planes measure_slopes label_planes"
    assert set(stable.split()) <= set(slopecli.__all__)


def test_type_checkers_see_the_same_names() -> None:
    tree = ast.parse((ROOT / "slopecli" / "__init__.py").read_text("utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {
        alias.asname: alias.name for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert sorted(typed) == slopecli.__all__
    assert all(shown == name for shown, name in typed.items())


def test_what_is_not_public_is_not_there() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'guess'"):
        slopecli.guess
    assert "__version__" in dir(slopecli)


def test_an_import_loads_nothing_heavy() -> None:
    script = "import sys, slopecli; slopecli.Options, slopecli.InputError; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not {"numpy", "cv2", "PIL", "scipy", "click", "rich"} & set(done.stdout.split())


def test_a_whole_estimate_needs_no_other_import(tmp_path: Path) -> None:
    folder = ROOT / "sample_data" / "descent"
    image1, image2 = (slopecli.load_image(folder / f"image{number}.png") for number in (1, 2))
    camera = slopecli.load_camera(folder / "camera.json")
    options = slopecli.Options(windows=((0, 0, 400, 400), (400, 400, 400, 400)))
    report = slopecli.estimate(image1, image2, camera, camera, options)
    assert [plane.id for plane in report.planes] == [1, 2]
    written = slopecli.write_outputs(report, image1, tmp_path)
    assert written[0].read_text() == slopecli.report_to_json(report) + "\n"


def test_no_public_name_is_that_of_a_module_beside_it() -> None:
    """Once that module is loaded, its package has the module under this name."""
    for path in sorted((ROOT / "slopecli").rglob("__init__.py")):
        package = importlib.import_module(".".join(path.parent.relative_to(ROOT).parts))
        modules = [one.stem for one in path.parent.iterdir() if one.suffix == ".py" or (one / "__init__.py").is_file()]
        for module in modules if hasattr(package, "__getattr__") else []:
            with pytest.raises(AttributeError, match="has no attribute"):
                package.__getattr__(module)
