"""The house holds: which way imports point, who opens files, what a help text may load, how long things are."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "slopecli"
MODULES = sorted(PACKAGE.rglob("*.py"))
FACE = PACKAGE / "__init__.py"  # publishes names of any room, each loaded when it is used
FLOORS = (
    "errors face types options windows",
    "geometry",
    "look",
    "ground",
    "patches",
    "planes",
    "measure",
    "findings",
    "solving",
    "report",
    "sequence",
    "products",
    "pipeline",
    "plan study validate",
    "io",
    "library",
    "batch",
    "cli",
    "__main__",
)
FLOOR_OF = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms.split()}
FILE_CALLS = {"open", "imread", "imwrite", "imreadmulti", "read_text", "read_bytes", "write_text", "write_bytes"}
SLOW_TO_IMPORT = {"scipy", "skimage", "tifffile", "matplotlib", "trimesh", "rich", "distributed", "threadpoolctl"} | {
    "h5py",
    "laspy",
    "pandas",
    "OpenEXR",
    "pyproj",
}
CALLERS = sorted(path for folder in ("tests", "benchmarks") for path in (ROOT / folder).rglob("*.py"))
# rooms publish their public names; one of the same name as its module can be had from the module alone
FROM_THE_MODULE = {"slopecli.batch.answer"}
DISTRIBUTION_OF = {
    "cv2": "opencv-contrib-python-headless",
    "PIL": "pillow",
    "skimage": "scikit-image",
    "yaml": "PyYAML",
}


def name_of(path: Path) -> str:
    return str(path.relative_to(PACKAGE))


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports_of(tree: ast.AST, package: str = "slopecli") -> Iterator[tuple[int, str]]:
    """Line and dotted name of everything imported anywhere below `tree`, in function bodies too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: relative import; write it from slopecli on"
            # `from slopecli import pipeline` names a room, not something in the package itself
            names = [f"{package}.{alias.name}" for alias in node.names] if node.module == package else [node.module]
            yield from ((node.lineno, str(name)) for name in names)


@cache
def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def third_party(tree: ast.AST) -> set[str]:
    roots = {name.split(".")[0] for _, name in imports_of(tree)}
    return roots - set(sys.stdlib_module_names) - {"slopecli"}


def top_level(tree: ast.Module) -> ast.Module:
    statements = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    return ast.Module(body=statements, type_ignores=[])


@pytest.mark.parametrize("path", [path for path in MODULES if path != FACE], ids=name_of)
def test_imports_point_up_the_list_only(path: Path) -> None:
    room = room_of(path)
    assert room in FLOOR_OF, "a new room needs its place in FLOORS"
    for line, name in imports_of(parse(path)):
        package, _, rest = name.partition(".")
        imported = rest.split(".")[0]
        if package == "slopecli" and name != "slopecli.__version__":
            assert imported in FLOOR_OF, f"{name_of(path)}:{line} imports {name}; inside, import from the module"
            below = FLOOR_OF[imported] < FLOOR_OF[room]
            nouns = FLOOR_OF[imported] == FLOOR_OF[room] == FLOOR_OF["types"]
            assert below or imported == room or nouns, f"{name_of(path)}:{line} ({room}) imports {name}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_every_room_uses_only_what_it_may(path: Path) -> None:
    room, used = room_of(path), third_party(parse(path))
    if room == "geometry":
        assert used <= {"numpy", "scipy", "threadpoolctl"}
    if room != "cli":
        assert not used & {"click", "rich"}
    if room in ("cli", "errors", "options"):
        assert used <= {"click", "rich"}, "the command line must answer --help without loading anything heavy"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_nothing_slow_is_imported_before_it_is_needed(path: Path) -> None:
    assert not third_party(top_level(parse(path))) & SLOW_TO_IMPORT


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_only_io_opens_files_and_nobody_prints_or_asserts(path: Path) -> None:
    for node in ast.walk(parse(path)):
        assert not isinstance(node, ast.Assert), f"{name_of(path)}:{node.lineno}: raise a SlopemapError instead"
        if isinstance(node, ast.Call):
            called = getattr(node.func, "id", getattr(node.func, "attr", ""))
            talks = called == "print" and (room_of(path) != "cli" or isinstance(node.func, ast.Name))
            assert not talks, f"{name_of(path)}:{node.lineno}: only the command line talks, by its own functions"
            opens = called in FILE_CALLS and not (called == "open" and ast.unparse(node.func) == "os.open")
            assert not opens or room_of(path) == "io", f"{name_of(path)}:{node.lineno} opens a file"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_modules_stay_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 350


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_functions_stay_short(path: Path) -> None:
    for node in ast.walk(parse(path)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert (node.end_lineno or 0) - node.lineno < 50, f"{name_of(path)}:{node.lineno} {node.name}"


def test_no_module_name_stands_in_two_rooms() -> None:
    """The modules of the command line are named after its commands."""
    names = [path.stem for path in MODULES if not path.stem.startswith("__") and room_of(path) != "cli"]
    assert [name for name, times in Counter(names).items() if times > 1] == []


def has_number(value: ast.expr | None) -> bool:
    """Whether a number other than 0, which stands for nothing, is part of an expression."""
    return value is not None and any(
        isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value for node in ast.walk(value)
    )


def constants_of(tree: ast.Module) -> list[str]:
    """Names in capitals that a module gives a number, or a table of numbers."""
    given = [node for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign) and has_number(node.value)]
    targets = [target for node in given for target in (node.targets if isinstance(node, ast.Assign) else [node.target])]
    leaves = [leaf for target in targets for leaf in (target.elts if isinstance(target, ast.Tuple) else [target])]
    return [leaf.id for leaf in leaves if isinstance(leaf, ast.Name) and leaf.id.isupper()]


def default_numbers_of(tree: ast.Module) -> list[str]:
    """Fields of dataclasses and named tuples whose default is a number."""
    kinds = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    return [
        f"{kind.name}.{ast.unparse(field.target)}"
        for kind in kinds
        for field in kind.body
        if isinstance(field, ast.AnnAssign) and has_number(field.value)
    ]


def test_numbers_are_few() -> None:
    """A number that no measurement defends is not introduced; one that states a known fact is imported."""
    constants = [name for path in MODULES for name in constants_of(parse(path))]
    defaults = [name for path in MODULES for name in default_numbers_of(parse(path))]
    assert len(constants) <= 220
    assert len(constants) + len(defaults) <= 450


@pytest.mark.parametrize("path", CALLERS, ids=lambda path: path.name)
def test_tests_and_benchmarks_import_from_rooms(path: Path) -> None:
    rooms = {".".join(module.relative_to(ROOT).parts[:-1]) for module in MODULES}
    for line, name in imports_of(parse(path)):
        inside = name.startswith("slopecli.") and name.count(".") > 1 and name not in rooms
        assert not inside or name in FROM_THE_MODULE, f"line {line} imports {name}; import from its room"


def test_dependencies_are_those_imported() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    requirements = project["dependencies"] + extras["cluster"] + extras["h5"] + extras["las"] + extras["exr"]
    requirements += extras["pandas"]
    declared = {re.split(r"[<>=!~ ;\[]", requirement)[0].lower() for requirement in requirements}
    used = set().union(*(third_party(parse(path)) for path in MODULES))
    assert {DISTRIBUTION_OF.get(name, name).lower() for name in used} == declared


def loaded_by(*arguments: str) -> set[str]:
    """Top-level packages that a Python process with these arguments imports."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", *arguments], capture_output=True, text=True, encoding="utf-8", check=True
    )
    names = re.findall(r"^import time:[^|]*\|[^|]*\|\s*(\S+)$", done.stderr, re.MULTILINE)
    return {name.split(".")[0] for name in names}


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["--version"],
        ["estimate", "--help"],
        ["segment", "--help"],
        ["simulate", "--help"],
        ["solve", "--help"],
    ],
    ids=" ".join,
)
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    loaded = loaded_by("-m", "slopecli", *arguments)
    assert "click" in loaded
    assert not loaded & {"numpy", "cv2", "PIL", "yaml", *SLOW_TO_IMPORT}


def test_geometry_works_without_opencv() -> None:
    loaded = loaded_by("-c", "import slopecli.geometry")
    assert not loaded & {"cv2", "PIL", "click", *SLOW_TO_IMPORT}


def tracked_files() -> list[Path]:
    done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("not a git checkout")
    return [ROOT / name for name in done.stdout.split("\0") if name and (ROOT / name).is_file()]


def test_no_path_of_a_machine_is_in_the_project() -> None:
    paths = re.compile(rb"(?<![\w.>-])/(?:home|Users|root|work|builds|workspace|mnt)/[\w.]+|[A-Z]:\\\\?Users")
    found = [
        f"{path.relative_to(ROOT)}: {match[0].decode()}"
        for path in tracked_files()
        if b"\0" not in (content := path.read_bytes())
        for match in [paths.search(content)]
        if match
    ]
    assert not found
