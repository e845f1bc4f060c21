"""Content of a camera file, parsed on demand: binary data, text, XML, or a tree of names and values (JSON, YAML)."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from slopecli.errors import InputError
from slopecli.io.cameras.values import Tree

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MAX_YAML_CHARACTERS = 4_000_000  # YAML is parsed at about 1 MB a second


class UnknownContent(InputError):
    """The file is of no kind that camera files have; the message does not name the file or the formats known."""


class CameraFileContent:
    """The bytes of a camera file and what they parse to.

    Each property parses when it is first read, so a format should look at the cheapest one first. `text`, `xml` and
    `tree` raise InputError when the file is damaged, and are empty when it is of another kind.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.is_binary = b"\0" in data[:64]

    @cached_property
    def text(self) -> str:
        """The file as UTF-8 text; "" for binary data."""
        try:
            return "" if self.is_binary else self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            raise UnknownContent("is neither text nor a COLMAP cameras.bin") from None

    @cached_property
    def xml(self) -> Element | None:
        """The root element of an XML file, None for other files."""
        from xml.etree import ElementTree

        if not self.text.lstrip().startswith("<"):
            return None
        try:
            return ElementTree.fromstring(self.text)
        except (ElementTree.ParseError, ValueError) as error:
            raise InputError(f"is damaged XML ({error})") from None

    @cached_property
    def tree(self) -> Tree:
        """Names and values of a JSON or YAML file, of the first document that is not empty; {} for other files."""
        if self.is_binary or self.xml is not None:
            return {}
        tree = _parse_json(self.text) if self.text.lstrip().startswith(("{", "[")) else _parse_yaml(self.text)
        return tree if isinstance(tree, Mapping) else {}


def _parse_json(text: str) -> Any:
    try:
        return json.loads(text)
    except RecursionError:
        raise InputError("is JSON nested too deeply for a camera file") from None
    except json.JSONDecodeError as error:
        try:
            return _parse_yaml(text)  # OpenCV's JSON has numbers like "1.", which only YAML accepts
        except InputError:
            raise InputError(f"is damaged JSON ({error})") from None


def _parse_yaml(text: str) -> Any:
    import yaml

    if len(text) > MAX_YAML_CHARACTERS:
        raise InputError(f"is {len(text) / 1e6:.0f} MB of text that is not JSON, too large for a camera file")
    # OpenCV writes a version directive that YAML parsers do not accept
    text = re.sub(r"\A%YAML[^\n]*\n", "", text)
    try:
        documents = yaml.load_all(text, Loader=_yaml_loader())
        return next((tree for tree in documents if tree is not None), None)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        problem = getattr(error, "problem", None) or type(error).__name__
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark is not None else ""
        raise UnknownContent(f"is neither JSON nor YAML ({problem}{where})") from None


def _yaml_loader() -> Any:
    """A safe loader that also knows OpenCV's matrices and Python's tuples."""
    import yaml

    base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    loader: Any = type("CameraLoader", (base,), {})
    loader.add_multi_constructor(
        "tag:yaml.org,2002:opencv-", lambda loader, _, node: loader.construct_mapping(node, deep=True)
    )
    loader.add_constructor(
        "tag:yaml.org,2002:python/tuple", lambda loader, node: loader.construct_sequence(node, deep=True)
    )
    return loader
