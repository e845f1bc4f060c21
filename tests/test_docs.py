"""The documents say what the program does: the reference, the README's example, every link."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import re
import runpy
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

import slopecli
from slopecli.batch import COLUMNS, TRANSIENT, Outcome, run
from slopecli.cli import PAIRINGS
from slopecli.findings import CODES
from slopecli.ground import cell_grid, footprint_planes, lander, map_task, safety, sites, tilt_uncertainty
from slopecli.look import FINE, dense_depth
from slopecli.look import gradient_components as segmentation
from slopecli.options import MapOptions, Options
from slopecli.patches.regions import REGION
from slopecli.plan import Plan, PlannedWindow, baseline, prediction
from slopecli.products import BANDS, MAP_PRODUCTS
from slopecli.report import kinds

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")])
GENERATE = runpy.run_path(str(ROOT / "docs" / "generate.py"))
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
SEGMENT = (ROOT / "docs" / "segment.md").read_text(encoding="utf-8")
BATCH = (ROOT / "docs" / "batch.md").read_text(encoding="utf-8")
PLAN = (ROOT / "docs" / "plan.md").read_text(encoding="utf-8")
SOLVE = (ROOT / "docs" / "solve.md").read_text(encoding="utf-8")
MAP = (ROOT / "docs" / "map.md").read_text(encoding="utf-8")
SIGMA_TOO = re.compile(r"(± )?([-+]?\d+(?:\.(\d+))?)")
LARGE_PERCENT = 2.0  # planes of the example that any build of OpenCV finds alike


def assert_as_with_another_opencv(shown: str, now: str) -> None:
    """The numbers of a document against those of another version of OpenCV, which moves matches.

    A sigma, after its ±, differs by 15 % or one in its last digit (0.12 may be 0.13); others by ten in their last
    decimal (slopes by 0.1°, P(safe) by 0.01), whole numbers by 5 %.
    """
    numbers = [list(SIGMA_TOO.finditer(text)) for text in (shown, now)]
    assert len(numbers[0]) == len(numbers[1])
    for one, other in zip(*numbers, strict=True):
        last = 10.0 ** -len(one[3] or "")
        other_ways = {"abs": 10.0 * last, "rel": 0.0} if one[3] else {"abs": 0.1, "rel": 0.05}
        how = {"abs": 1.1 * last, "rel": 0.15} if one[1] else other_ways
        assert float(other[2]) == pytest.approx(float(one[2]), **how), (shown, now)


def test_sigmas_in_documents_are_held_closer_than_slopes() -> None:
    assert_as_with_another_opencv("17.49 ± 0.12°  0.0021  595/600", "17.55 ± 0.13°  0.0018  592/601")
    for wrong in ("17.49 ± 0.15°  0.0021  595/600", "17.49 ± 0.12°  0.0040  595/600", "17.70 ± 0.12°  0.0021  595/600"):
        with pytest.raises(AssertionError):
            assert_as_with_another_opencv("17.49 ± 0.12°  0.0021  595/600", wrong)


def test_command_reference_is_current() -> None:
    # line breaks are the terminal's, not ours
    assert (ROOT / "docs" / "cli.md").read_text(encoding="utf-8").split() == GENERATE["cli_reference"]().split(), (
        "docs/cli.md is not what --help says: run `make docs`"
    )


@pytest.mark.parametrize(("path", "text"), list(GENERATE["commands"](GENERATE["slopemap"])))
def test_reference_has_every_option(path: str, text: str) -> None:
    reference = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    assert f"## {path}\n" in reference
    for option in re.findall(r"^  (?:-\w, )?(--[\w-]+)", text, re.MULTILINE):
        assert option in reference


def test_readme_example_is_what_the_command_prints(tmp_path: Path) -> None:
    example = GENERATE["EXAMPLE"].search((ROOT / "README.md").read_text(encoding="utf-8"))
    output = GENERATE["run_example"](example["command"], tmp_path)
    assert NUMBER.sub("#", " ".join(example["output"].split())) == NUMBER.sub("#", " ".join(output.split()))
    assert_as_with_another_opencv(example["output"], output)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    targets = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", document.read_text(encoding="utf-8"))
    missing = [target for target in targets if not (document.parent / target).exists()]
    assert not missing


def test_readme_commands_are_make_targets() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    asked = set(re.findall(r"^make ([a-z-]+)", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE))
    assert asked
    assert asked <= targets


# ---- docs/api.md and docs/library.ipynb ----


def test_python_reference_is_current() -> None:
    made = runpy.run_path(str(ROOT / "docs" / "api_page.py"))["api_reference"]()
    assert (ROOT / "docs" / "api.md").read_text(encoding="utf-8") == made, "run `make docs`"


def test_python_reference_has_every_name_and_every_option() -> None:
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^### (\w+)$", text, re.MULTILINE)) == slopecli.__all__
    missing = [one.name for one in (*fields(Options), *fields(MapOptions)) if f"\n{one.name}: " not in text]
    assert missing == []
    assert "\n- `to_json()`: " in text


def test_notebook_of_the_library_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its code cells one after the other, beside the sample data, as a reader runs them."""
    cells = json.loads((ROOT / "docs" / "library.ipynb").read_text(encoding="utf-8"))["cells"]
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    monkeypatch.chdir(tmp_path)
    values: dict[str, Any] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), values)
    truth = json.loads((ROOT / "sample_data" / "descent" / "truth.json").read_text(encoding="utf-8"))
    slopes = [plane.slope_deg for plane in values["report"].planes]
    assert slopes == pytest.approx([one["slope_deg"] for one in truth["windows"]], abs=0.5)
    assert (tmp_path / "answer" / "slopes.json").exists()


def test_page_on_metadata_has_its_tables() -> None:
    text = (ROOT / "docs" / "drone.md").read_text(encoding="utf-8")
    assert GENERATE["lenses_table"]() in text
    assert GENERATE["attitudes_table"]() in text


# ---- docs/cameras.md ----


def test_camera_example_is_what_the_command_prints(tmp_path: Path) -> None:
    example = GENERATE["EXAMPLE"].search((ROOT / "docs" / "cameras.md").read_text(encoding="utf-8"))
    assert GENERATE["run_example"](example["command"], tmp_path) == example["output"]


# ---- docs/segment.md ----


def planes_of(table: str) -> dict[int, tuple[str, float, float]]:
    """Kind, share of the image in % and slope by id, out of what `slopemap segment` prints."""
    rows = re.findall(r"^ *(\d+)  (\w+) +([\d.]+) % +([\d.]+) ±", table, re.MULTILINE)
    return {int(number): (kind, float(share), float(slope)) for number, kind, share, slope in rows}


@pytest.mark.slow
def test_segment_example_is_what_the_command_prints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Large planes one by one, small ones by their number; then the page's own code reads the files."""
    example = GENERATE["EXAMPLE"].search(SEGMENT)
    output = GENERATE["run_example"](example["command"], tmp_path)
    shown, now = planes_of(example["output"]), planes_of(output)
    assert example["output"].splitlines()[0].split() == output.splitlines()[0].split()
    assert len(now) == pytest.approx(len(shown), rel=0.2)
    large = [plane for plane in shown.values() if plane[1] > LARGE_PERCENT]
    assert len(large) >= 4
    for kind, share, slope in large:
        alike = [one for one in now.values() if one[0] == kind and abs(one[2] - slope) < 0.5]
        assert any(one[1] == pytest.approx(share, rel=0.15) for one in alike), (kind, share, slope)
    for line in ("up: (", "info: unexplained: ", "wrote urban_output/slopes.json"):
        assert line in example["output"]
        assert line in output
    monkeypatch.chdir(tmp_path)
    for code in re.findall(r"```python\n(.*?)```", SEGMENT, re.DOTALL):
        values: dict[str, object] = {}
        exec(code, values)
        assert values["steep"]


def test_segment_page_shows_what_each_option_does() -> None:
    (section,) = re.findall(r"^## Options$(.*?)^## ", SEGMENT, re.MULTILINE | re.DOTALL)
    for option in ("gradient-threshold", "merge-px", "min-region"):
        assert f"`--{option} " in section
        assert f"images/segment_{option.replace('-', '_')}.jpg" in section


def test_segment_page_has_the_numbers_of_the_code() -> None:
    text = " ".join(SEGMENT.split())
    for said in (
        f"Steeper than {kinds.WALL_DEG:.0f}° from level: **wall**",
        f"level is below {kinds.LEVEL_DEG:.0f}° with a sigma below {kinds.IN_DOUBT_DEG:.0f}°",
        f"stands off by less than {100 * kinds.APART:.0f} % of its distance",
        f"{100 * segmentation.INTERIOR_SHARE:.0f} % of it count as inside",
        f"down to {100 * REGION.least_share:g} % of the image",
    ):
        assert said in text
    assert pytest.approx(0.1) == kinds.LARGE  # "a tenth of the largest"
    assert pytest.approx(5e5) == FINE.max_pixels  # "half a megapixel"


def test_the_schema_lists_what_the_rows_have() -> None:
    assert GENERATE["SCHEMA"].read_text(encoding="utf-8") == GENERATE["schema"](), "run `make docs`"


def test_pictures_are_small() -> None:
    pictures = list((ROOT / "docs" / "images").glob("segment_*"))
    assert pictures
    assert all(picture.stat().st_size < 150_000 for picture in pictures)


# ---- docs/batch.md ----


@pytest.mark.slow
def test_batch_example_is_what_the_command_prints(tmp_path: Path) -> None:
    example = GENERATE["EXAMPLE"].search(BATCH)
    output = GENERATE["run_example"](example["command"], tmp_path)
    shown, now = ([line.split() for line in text.splitlines()] for text in (example["output"], output))
    assert now[0] == shown[0]
    assert [row[:2] for row in now[1:]] == [row[:2] for row in shown[1:]]
    # "-" where no window is known well enough
    steepest = [[float(row[2].replace("-", "nan")) for row in rows[1:]] for rows in (shown, now)]
    assert steepest[1] == pytest.approx(steepest[0], abs=1.0, nan_ok=True)
    assert (tmp_path / "batch_output" / "index.html").exists()


def test_batch_page_has_every_key_of_an_outcome_and_every_way_of_pairing() -> None:
    keys = [field.name for field in fields(Outcome)]
    assert [key for key in keys if f"`{key}`" not in BATCH] == []
    listed = [
        key for line in BATCH.splitlines() if "| yes |" in line for key in re.findall(r"`(\w+)`", line.split("|")[1])
    ]
    assert sorted(listed) == sorted(COLUMNS)
    assert all(f"`{word}`" in BATCH for word in PAIRINGS)


def test_batch_page_names_the_failures_that_are_tried_again() -> None:
    assert set(re.findall(r"^\| `(\w+)` .* tries again \|$", BATCH, re.MULTILINE)) == TRANSIENT


@pytest.mark.parametrize("code", re.findall(r"```python\n(.*?)```", BATCH, re.DOTALL), ids=["slurm", "mpi"])
def test_batch_code_calls_what_there_is(code: str) -> None:
    """The executors of others are not at hand here; everything of ours is."""
    for module, name in re.findall(r"^from (slopecli[\w.]*) import (\w+)", code, re.MULTILINE):
        assert hasattr(importlib.import_module(module), name)
    (call,) = (
        node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call) and ast.unparse(node.func) == "run"
    )
    inspect.signature(run).bind(*call.args, **{str(keyword.arg): keyword.value for keyword in call.keywords})


# ---- docs/solve.md ----


def test_solve_example_is_what_the_command_prints(tmp_path: Path) -> None:
    example = GENERATE["EXAMPLE"].search(SOLVE)
    output = GENERATE["run_example"](example["command"], tmp_path)
    assert NUMBER.sub("#", " ".join(example["output"].split())) == NUMBER.sub("#", " ".join(output.split()))
    shown, now = (list(map(float, NUMBER.findall(text))) for text in (example["output"], output))
    assert now == pytest.approx(shown, abs=0.011)


def test_solve_page_has_every_format_and_way() -> None:
    assert GENERATE["match_formats_table"]() in SOLVE, "docs/solve.md is not what the rows say: run `make docs`"
    ways = re.findall(r"`--(planes|grid|window|labels|pair|keypoints|seed)\b", SOLVE)
    assert set(ways) == {"planes", "grid", "window", "labels", "pair", "keypoints", "seed"}


# ---- docs/plan.md ----


def test_plan_example_is_what_the_command_prints(tmp_path: Path) -> None:
    example = GENERATE["EXAMPLE"].search(PLAN)
    output = GENERATE["run_example"](example["command"], tmp_path)
    assert NUMBER.sub("#", " ".join(example["output"].split())) == NUMBER.sub("#", " ".join(output.split()))
    shown, now = (list(map(float, NUMBER.findall(text))) for text in (example["output"], output))
    assert now == pytest.approx(shown, rel=0.02, abs=0.011)


def test_plan_page_has_every_key_and_the_limits_of_the_code() -> None:
    keys = [field.name for kind in (Plan, PlannedWindow) for field in fields(kind)]
    assert [key for key in keys if f"`{key}`" not in PLAN and key != "id"] == []
    assert "Twenty pairs are simulated" in PLAN
    assert prediction.TRIALS == 20
    assert "at least half of themselves in image 2" in PLAN
    assert pytest.approx(0.5) == baseline.LEAST_MATCHED


# ---- docs/map.md ----


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str, Path]:
    """What the page says the first command prints, what it prints now, and the folder it ran in."""
    folder = tmp_path_factory.mktemp("map")
    example = GENERATE["EXAMPLE"].search(MAP)
    return example["output"], GENERATE["run_example"](example["command"], folder), folder


def compare_maps(shown: str, now: str) -> None:
    """Sites in number and the size of the best, and the shares of the ground: cells differ with the build of OpenCV."""
    assert now.splitlines()[0].split() == shown.splitlines()[0].split()
    rows = [re.findall(r"^ +\d+ .* (\d+) px = +([\d.]+) m", text, re.MULTILINE) for text in (shown, now)]
    assert len(rows[0]) == len(rows[1]) > 0
    assert [float(size) for size in rows[1][0]] == pytest.approx([float(size) for size in rows[0][0]], rel=0.1)
    grounds = [re.search(r"^ground: (.*)$", text, re.MULTILINE)[1] for text in (shown, now)]
    assert NUMBER.sub("#", grounds[0]) == NUMBER.sub("#", grounds[1])
    shares = [list(map(float, NUMBER.findall(ground))) for ground in grounds]
    assert shares[1] == pytest.approx(shares[0], abs=1.5, rel=0.02)


def test_map_example_is_what_the_command_prints(mapped: tuple[str, str, Path]) -> None:
    compare_maps(*mapped[:2])


@pytest.mark.slow
def test_map_example_with_a_lander_is_what_the_command_prints(tmp_path: Path) -> None:
    _, example = GENERATE["EXAMPLE"].finditer(MAP)
    compare_maps(example["output"], GENERATE["run_example"](example["command"], tmp_path))


def test_map_of_the_demo_agrees_with_the_truth(
    mapped: tuple[str, str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    check = runpy.run_path(str(ROOT / "sample_data" / "check_demo.py"))["main"]
    slopes, truth = mapped[2] / "map_output" / "slopes.json", ROOT / "sample_data" / "descent" / "truth.json"
    assert check(str(slopes), str(truth)) == 0
    assert "9 of 9 discs" in capsys.readouterr().out
    wrong = json.loads(slopes.read_text(encoding="utf-8"))
    wrong["sites"][0]["centre_px"] = [400.0, 400.0]
    (slopes.parent / "wrong.json").write_text(json.dumps(wrong), encoding="utf-8")
    assert check(str(slopes.parent / "wrong.json"), str(truth)) == 1


def test_code_of_the_map_page_runs(
    mapped: tuple[str, str, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(mapped[2])
    (code,) = re.findall(r"```python\n(.*?)```", MAP, re.DOTALL)
    exec(code, {})
    assert "safe with" in capsys.readouterr().out


def test_map_page_has_every_band_and_the_numbers_of_the_code() -> None:
    assert [band for band in BANDS if f"\n| `{band}` | " not in MAP] == []
    assert [one.file for one in MAP_PRODUCTS if f"| `{one.file}` | " not in MAP] == []
    text, heights = " ".join(MAP.split()), safety.SAFETY
    for said in (
        f"less than {100 * footprint_planes.LEAST_SHARE:g} % of the footprint",
        f"be at least {cell_grid.GRID.least_footprint_px:g} px",
        f"for at least {100 * tilt_uncertainty.TILT.step_length:g} % of that diameter",
        f"Images larger than {dense_depth.DEPTH.most_pixels / 1e6:.1f} megapixels",
        f"less than {dense_depth.ON_PLANE_PX:g} px, where nothing",
        f"within {dense_depth.DEPTH.beside_px} px",
        f"by {heights.flattened_gsd:g} pixels of ground on average, with a sigma of {heights.flattened_sigma_gsd:g}",
        f"{safety.least_limit(1.0, 0.99):.1f} g for 0.99",
        f"P(safe) is at most {map_task.WITHHELD:g}",
        f"After {sites.MOST_FAILURES} places",
        f"{lander.HEADING_STEP_DEG:g}° or less apart",
        f"up to `--sites N` ({MapOptions().sites})",
    ):
        assert said in text, said
    cells = cell_grid.choose_cells(
        2560, 1600, 1.0, None, None
    )  # "a sixteenth of the short side", "an eighth of the footprint"
    assert (cells.footprint_px, cells.spacing_px) == (100.0, 12)
    assert (footprint_planes.BLOCKS, dense_depth.DEPTH.rounds) == (12, 3)
    assert pytest.approx(0.25) == tilt_uncertainty.TILT.step_share  # "a quarter of the footprint's diameter"
    forbidding = {code.code for code in CODES if code.forbids_safe}
    assert [code for code in sorted(forbidding - {"level-assumed"}) if f"`{code}`" not in text] == []


def test_picture_of_the_map_is_small() -> None:
    assert (ROOT / "docs" / "images" / "map.jpg").stat().st_size < 400_000


def test_the_page_of_the_package_is_the_readme_with_links_that_lead_somewhere() -> None:
    page = GENERATE["package_page"]()
    assert (ROOT / "docs" / "package_page.md").read_text(encoding="utf-8") == page, "run `make docs`"
    links = re.findall(r"\]\(([^)]+)\)", page)
    assert len(links) > 20
    assert all(link.startswith("https://") for link in links)


def test_the_site_has_every_page_and_begins_with_what_it_cannot_do() -> None:
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = re.findall(r"([a-z_]+\.md)$", settings[settings.index("nav:") :], re.MULTILINE)
    assert pages[:2] == ["index.md", "limits.md"]
    assert sorted(pages) == sorted(path.name for path in (ROOT / "docs").glob("*.md") if path.name != "package_page.md")


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda path: path.name)
def test_links_of_a_page_of_the_site_stay_in_it(page: Path) -> None:
    """As the site is built, where what lies above docs/ is not; anchors are those of titles."""
    for target, anchor in re.findall(r"\]\((?!https?:)([^)#]*)(?:#([^)]*))?\)", page.read_text(encoding="utf-8")):
        file = page.parent / target if target else page
        assert file.resolve().is_relative_to(ROOT / "docs"), target
        if anchor:
            titles = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower()) for title in titles}
            assert anchor in slugs, f"{target}#{anchor}"


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    build = pytest.importorskip("mkdocs.commands.build", reason="the site is built where mkdocs-material is installed")
    pytest.importorskip("material")
    from mkdocs.config import load_config

    build.build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(tmp_path)))
    assert (tmp_path / "limits.html").exists()
