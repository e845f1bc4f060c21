"""Verdicts and figures of docs/simulate.md, made by running the command. `make docs` runs it; alone it does too."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "simulate.md"
MARKS = ("<!-- study: begin -->", "<!-- study: end -->")
FIGURES = ("figure2_alignment", "figure4_motion", "figure5_slopes", "figure6_time")
WIDTH, COLOURS = 900, 256  # px of a figure on the page, and of its palette


def make_study_figures(images: Path) -> None:
    """Run the default study, write its figures, small, into `images` and its verdicts into the page."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "slopecli", "simulate", "-o", folder]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, encoding="utf-8", check=True)
        for name in FIGURES:
            with Image.open(Path(folder, f"{name}.png")) as picture:
                shown = picture.convert("RGB")
                shown.thumbnail((WIDTH, 10 * WIDTH), Image.Resampling.LANCZOS)
                shown.quantize(COLOURS, Image.Quantize.MAXCOVERAGE).save(images / f"simulate_{name}.png", optimize=True)
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.split(MARKS[0])[0], text.split(MARKS[1])[1]
    block = f"{MARKS[0]}\n```text\n{done.stdout}```\n{MARKS[1]}"
    PAGE.write_text(before + block + after, encoding="utf-8")


if __name__ == "__main__":
    make_study_figures(ROOT / "docs" / "images")
