"""The house holds: which way imports point, who opens files, what a help text may load, how long things are."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
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
BRANCHES = (ast.If, ast.For, ast.While, ast.ExceptHandler, ast.BoolOp, ast.IfExp, ast.comprehension, ast.Assert)
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


@dataclass(frozen=True)
class Module:
    """What the rules look at in a module; the lines and names of what stands anywhere in it, in function bodies too.

    imports_at_top : those at the top level alone.  calls : with the name called, and the whole of it as written.
    lengths, branches : of functions.  unexplained : public ones of more than five lines without a docstring.
    constants : names in capitals that are given a number, or a table of numbers.
    defaults : fields of dataclasses and named tuples whose default is a number.
    """

    imports: list[tuple[int, str]]
    imports_at_top: list[tuple[int, str]]
    asserts: list[int]
    calls: list[tuple[int, str, str]]
    lengths: list[tuple[int, str, int]]
    branches: list[tuple[int, str, int]]
    unexplained: list[tuple[int, str]]
    constants: list[str]
    defaults: list[str]


@cache
def module(path: Path) -> Module:
    """Its tree is not kept: half a million nodes would be gone through by every collection of garbage."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = list(ast.walk(tree))
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    calls = [(node.lineno, node.func) for node in nodes if isinstance(node, ast.Call)]
    return Module(
        list(imports_of(nodes)),
        list(imports_of(tree.body)),
        [node.lineno for node in nodes if isinstance(node, ast.Assert)],
        [
            (line, name, ast.unparse(func))
            for line, func in calls
            if (name := getattr(func, "id", getattr(func, "attr", ""))) in {*FILE_CALLS, "print"}
        ],
        [(node.lineno, node.name, len_of(node)) for node in functions],
        [(node.lineno, node.name, branches_of(node)) for node in functions],
        [
            (node.lineno, node.name)
            for node in functions
            if not node.name.startswith("_") and len_of(node) > 5 and ast.get_docstring(node) is None
        ],
        constants_of(tree),
        default_numbers_of(nodes),
    )


def branches_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Ways through a function: one, and one for every condition, loop and exception in it."""
    return 1 + sum(isinstance(node, BRANCHES) for node in ast.walk(function))


def len_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    return (function.end_lineno or 0) - function.lineno + 1


def imports_of(nodes: Iterable[ast.AST], package: str = "slopecli") -> Iterator[tuple[int, str]]:
    """Line and dotted name of everything that the nodes import."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: relative import; write it from slopecli on"
            # `from slopecli import pipeline` names a room, not something in the package itself
            names = [f"{package}.{alias.name}" for alias in node.names] if node.module == package else [node.module]
            yield from ((node.lineno, str(name)) for name in names)


def has_number(value: ast.expr | None) -> bool:
    """Whether a number other than 0, which stands for nothing, is part of an expression."""
    return value is not None and any(
        isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value for node in ast.walk(value)
    )


def constants_of(tree: ast.Module) -> list[str]:
    given = [node for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign) and has_number(node.value)]
    targets = [target for node in given for target in (node.targets if isinstance(node, ast.Assign) else [node.target])]
    leaves = [leaf for target in targets for leaf in (target.elts if isinstance(target, ast.Tuple) else [target])]
    return [leaf.id for leaf in leaves if isinstance(leaf, ast.Name) and leaf.id.isupper()]


def default_numbers_of(nodes: Iterable[ast.AST]) -> list[str]:
    return [
        f"{kind.name}.{ast.unparse(field.target)}"
        for kind in nodes
        if isinstance(kind, ast.ClassDef)
        for field in kind.body
        if isinstance(field, ast.AnnAssign) and has_number(field.value)
    ]


def third_party(imports: Iterable[tuple[int, str]]) -> set[str]:
    roots = {name.split(".")[0] for _, name in imports}
    return roots - set(sys.stdlib_module_names) - {"slopecli"}


def test_imports_point_up_the_list_only() -> None:
    assert {room_of(path) for path in MODULES if path != FACE} <= {*FLOOR_OF}, "a new room needs its place in FLOORS"
    wrong = []
    for path in (path for path in MODULES if path != FACE):
        room = room_of(path)
        for line, name in module(path).imports:
            package, _, rest = name.partition(".")
            imported = rest.split(".")[0]
            if package == "slopecli" and name != "slopecli.__version__":
                floor = FLOOR_OF.get(imported)  # inside, one imports from the module
                nouns = floor == FLOOR_OF[room] == FLOOR_OF["types"]
                if floor is None or not (floor < FLOOR_OF[room] or imported == room or nouns):
                    wrong.append(f"{name_of(path)}:{line} ({room}) imports {name}")
    assert not wrong


def test_every_room_uses_only_what_it_may() -> None:
    wrong = []
    for path in MODULES:
        room, used = room_of(path), third_party(module(path).imports)
        if room == "geometry":
            used -= {"numpy", "scipy", "threadpoolctl"}
        elif room in ("cli", "errors", "options"):  # the command line must answer --help without loading anything heavy
            used -= {"click", "rich"} if room == "cli" else set()
        else:
            used &= {"click", "rich"}
        wrong += [f"{name_of(path)} imports {name}" for name in used]
    assert not wrong


def test_nothing_slow_is_imported_before_it_is_needed() -> None:
    loaded = {name_of(path): third_party(module(path).imports_at_top) & SLOW_TO_IMPORT for path in MODULES}
    assert not {name: slow for name, slow in loaded.items() if slow}


def test_only_io_opens_files_and_nobody_prints_or_asserts() -> None:
    """A SlopemapError is raised in place of an assertion; only the command line talks, by its own functions."""
    wrong = []
    for path in MODULES:
        wrong += [f"{name_of(path)}:{line} asserts" for line in module(path).asserts]
        for line, called, written in module(path).calls:
            if called == "print":
                allowed = room_of(path) == "cli" and written != "print"
            else:
                allowed = room_of(path) == "io" or written == "os.open"
            wrong += [f"{name_of(path)}:{line} calls {written}"] if not allowed else []
    assert not wrong


def test_modules_stay_short() -> None:
    lengths = {name_of(path): len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    assert not {name: length for name, length in lengths.items() if length > 350}


def test_functions_stay_short() -> None:
    lengths = [(path, *one) for path in MODULES for one in module(path).lengths]
    assert not [f"{name_of(path)}:{line} {name}" for path, line, name, length in lengths if length > 50]


def test_functions_branch_little() -> None:
    branches = [(path, *one) for path in MODULES for one in module(path).branches]
    assert not [f"{name_of(path)}:{line} {name}" for path, line, name, number in branches if number > 14]


def test_public_functions_have_a_docstring() -> None:
    assert not [f"{name_of(path)}:{line} {name}" for path in MODULES for line, name in module(path).unexplained]


def test_no_module_name_stands_in_two_rooms() -> None:
    """The modules of the command line are named after its commands."""
    names = [path.stem for path in MODULES if not path.stem.startswith("__") and room_of(path) != "cli"]
    assert [name for name, times in Counter(names).items() if times > 1] == []


def test_numbers_are_few() -> None:
    """A number that no measurement defends is not introduced; one that states a known fact is imported."""
    constants = [name for path in MODULES for name in module(path).constants]
    defaults = [name for path in MODULES for name in module(path).defaults]
    assert len(constants) <= 220
    assert len(constants) + len(defaults) <= 450


def test_tests_and_benchmarks_import_from_rooms() -> None:
    rooms = {".".join(path.relative_to(ROOT).parts[:-1]) for path in MODULES}
    wrong = []
    for path in CALLERS:
        for line, name in module(path).imports:
            inside = name.startswith("slopecli.") and name.count(".") > 1 and name not in rooms
            if inside and name not in FROM_THE_MODULE:
                wrong.append(f"{path.name}:{line} imports {name}")
    assert not wrong


def test_dependencies_are_those_imported() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    requirements = project["dependencies"] + extras["cluster"] + extras["h5"] + extras["las"] + extras["exr"]
    requirements += extras["pandas"]
    declared = {re.split(r"[<>=!~ ;\[]", requirement)[0].lower() for requirement in requirements}
    used = set().union(*(third_party(module(path).imports) for path in MODULES))
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
