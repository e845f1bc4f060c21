"""One input of the campaign: files and a command line; how it is kept and read again."""

from __future__ import annotations

import base64
import json
import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path

FOLDER, FIFO, LINK = "folder", "fifo", "link "  # what a file may be that is not bytes; a link is followed by its target
Content = bytes | str


@dataclass(frozen=True)
class Case:
    """files by their path, relative to the folder in which `slopemap` with `arguments` is run.

    expected : files below it afterwards, where they are known.
    """

    kind: str
    arguments: list[str]
    files: dict[str, Content] = field(repr=False)
    expected: dict[str, bytes] = field(default_factory=dict, repr=False)

    def lay_out(self, folder: Path) -> None:
        """Make the folder with the files and nothing else."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for name, content in self.files.items():
            place = folder / name
            place.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, bytes):
                place.write_bytes(content)
            elif content == FOLDER:
                place.mkdir(exist_ok=True)
            elif content == FIFO:
                os.mkfifo(place)
            else:
                place.symlink_to(content.removeprefix(LINK))

    def keep(self, folder: Path, complaints: list[str]) -> None:
        """Write the case to a folder: case.json, from which it is read again, the files to look at, the complaints."""
        self.lay_out(folder / "files")
        (folder / "complaints.txt").write_text("\n".join(complaints) + "\n", "utf-8", errors="backslashreplace")
        document = {
            "kind": self.kind,
            "arguments": self.arguments,
            "files": {name: _encoded(content) for name, content in self.files.items()},
            "expected": {name: _encoded(content) for name, content in self.expected.items()},
        }
        (folder / "case.json").write_text(json.dumps(document, indent=1))


def read_case(folder: Path) -> Case:
    """The case that `Case.keep` wrote."""
    document = json.loads((folder / "case.json").read_text())
    files, expected = (
        {name: base64.b64decode(text[1:]) if text.startswith("=") else text for name, text in document[key].items()}
        for key in ("files", "expected")
    )
    return Case(document["kind"], document["arguments"], files, expected)


def _encoded(content: Content) -> str:
    return f"={base64.b64encode(content).decode()}" if isinstance(content, bytes) else content
