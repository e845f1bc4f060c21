"""Tables in the documents, between marks that say which benchmark wrote them."""

from __future__ import annotations

import sys
from pathlib import Path


def write_between(document: Path, name: str, text: str) -> None:
    """Put `text` between the document's lines `<!-- name: begin -->` and `<!-- name: end -->`."""
    content = document.read_text(encoding="utf-8")
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    if any(content.count(mark) != 1 for mark in (begin, end)):
        sys.exit(f"{document}: needs the lines {begin} and {end} once each")
    before, after = content.split(begin)[0], content.split(end)[1]
    document.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}", encoding="utf-8")
