"""The documents say what the program does: the reference, the README's example, every link."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")])
GENERATE = runpy.run_path(str(ROOT / "docs" / "generate.py"))
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")


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
    shown, now = (list(map(float, NUMBER.findall(text))) for text in (example["output"], output))
    # another OpenCV build may move a match: 0.1 degrees, or 5 % of a count
    assert now == pytest.approx(shown, abs=0.1, rel=0.05)


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
