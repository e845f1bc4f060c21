"""Content of a camera file, parsed on demand: binary data, text, XML, or a tree of names and values (JSON, YAML)."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from slopecli.errors import InputError
from slopecli.io.cameras.values import Tree, refuse_twice
from slopecli.io.cameras.yaml_documents import yaml_documents
from slopecli.io.files import UTF16_MARKS, mostly_ascii

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MATLAB_MARKS = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")


Beside = Callable[[str], bytes | None]  # bytes of a file of this name beside the camera file, None if there is none


class UnknownContent(InputError):
    """The file is of no kind that camera files have; the message does not name the file or the formats known."""


class CameraFileContent:
    """The bytes of a camera file and what they parse to.

    Each property parses when it is first read, so a format should look at the cheapest one first. `text`, `xml` and
    `tree` raise InputError when the file is damaged, and are empty when it is of another kind. `notes` are for users.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.is_binary = (b"\0" in data[:64] and not data.startswith(UTF16_MARKS)) or data.startswith(MATLAB_MARKS)
        self.notes: list[str] = []

    @classmethod
    def of_tree(cls, tree: Tree) -> CameraFileContent:
        """Content that is a part of another file: names and values."""
        content = cls(b"")
        content.documents = [tree]
        return content

    @cached_property
    def text(self) -> str:
        """The file as text: UTF-8, UTF-16 with its mark, or Latin-1; the label of an image; "" for binary data."""
        return "" if self.is_binary else _decode(_label(self.data))

    @cached_property
    def xml(self) -> Element | None:
        """The root element of an XML file, None for other files."""
        from xml.etree import ElementTree

        if not self.text.lstrip().startswith("<"):
            return None
        if "<!ENTITY" in self.text:
            raise InputError("is XML that defines entities, which no camera file does")
        try:
            return ElementTree.fromstring(self.text)
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise InputError(f"is damaged XML ({error})") from None

    @cached_property
    def documents(self) -> list[Any]:
        """The documents of a JSON or YAML file; none for other files."""
        if self.is_binary or self.xml is not None:
            return []
        parse = _parse_json if self.text.lstrip().startswith(("{", "[")) else _parse_yaml
        return [tree for tree in parse(self.text) if tree is not None]

    @cached_property
    def tree(self) -> Tree:
        """Names and values of a JSON or YAML file, of all its documents together; {} for other files."""
        return self._merged(self.documents)

    @cached_property
    def rows(self) -> list[Tree]:
        """Of a JSON or YAML file that is a list, the parts of it that are names with values; none for other files."""
        first = self.documents[0] if self.documents else None
        return [row for row in first if isinstance(row, Mapping)] if isinstance(first, list) else []

    def _merged(self, documents: list[Any]) -> Tree:
        """The names and values of all documents, which must not contradict each other; {} if the first has none."""
        if not documents or not isinstance(documents[0], Mapping):
            return {}
        merged = dict(documents[0])
        for tree in documents[1:]:
            if not isinstance(tree, Mapping):
                raise InputError(f"holds {len(documents)} documents, and not all are names with values; keep one")
            for key, value in tree.items():
                # messages of a camera repeat it with another header, which has the time
                if merged.setdefault(key, value) != value and key != "header":
                    raise InputError(f"holds {len(documents)} documents that differ in {key!r}; keep one of them")
        if len(merged) > len(documents[0]):
            self.notes.append(f"its {len(documents)} documents are read together")
        return merged


def _label(data: bytes) -> bytes:
    """The label in front of the pixels of a PDS or VICAR image; all of another file."""
    if not data.startswith((b"PDS_VERSION_ID", b"ODL_VERSION_ID", b"LBLSIZE=", b"CCSD")):
        return data
    label = data[:2_000_000].partition(b"\0")[0]  # labels have less than a tenth of that
    end = re.search(rb"^END\s*$", label, re.MULTILINE)
    return label[: end.end()] if end else label


def _decode(data: bytes) -> str:
    """Text of bytes. Where it is not UTF-8, most must be printable ASCII: the rest are names and comments."""
    try:
        if not data.startswith(UTF16_MARKS):
            return data.decode("utf-8-sig")
        text = data.decode("utf-16")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if not mostly_ascii(text):
        raise UnknownContent("is neither text nor a COLMAP cameras.bin")
    return text


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    refuse_twice(name for name, _ in pairs)
    return dict(pairs)


def _integer(text: str) -> float:
    """Python reads no integer of more than 4300 digits; one beyond any float is infinite."""
    return int(text) if len(text) < 300 else float(text)


def _parse_json(text: str) -> list[Any]:
    try:
        return [json.loads(text, object_pairs_hook=_unique, parse_int=_integer)]
    except RecursionError:
        raise InputError("is JSON nested too deeply for a camera file") from None
    except json.JSONDecodeError as error:
        if error.msg == "Extra data":
            raise InputError("holds more than one JSON value, one after the other; join them into one") from None
        try:
            return _parse_yaml(text)  # OpenCV's JSON has numbers like "1.", which only YAML accepts
        except UnknownContent as unknown:
            if "one after the other" in str(unknown):
                raise
            raise InputError(f"is damaged JSON ({error})") from None


def _parse_yaml(text: str) -> list[Any]:
    try:
        return yaml_documents(text)
    except ValueError as error:
        raise UnknownContent(str(error)) from None
