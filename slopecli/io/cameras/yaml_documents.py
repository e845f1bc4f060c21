"""Documents of a YAML file, read without trust: nothing that expands, nests deeply, or has a name twice."""

from __future__ import annotations

import re
from functools import partial
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras.values import first_twice

MAX_YAML_CHARACTERS = 4_000_000  # YAML is parsed at about 1 MB a second


def yaml_documents(text: str) -> list[Any]:
    """The documents of a YAML text, OpenCV's included.

    Raises
    ------
    ValueError : it is no YAML; the message says why.
    InputError : it is too large, nested too deeply, refers to itself, expands by aliases, or has a name twice.
    """
    import yaml

    if len(text) > MAX_YAML_CHARACTERS:
        raise InputError(f"is {len(text) / 1e6:.0f} MB of text that is not JSON, too large for a camera file")
    # OpenCV writes a version directive that YAML parsers do not accept, and reads names without a space after the colon
    if text.startswith("%YAML:"):
        text = re.sub(r"^([ \t]*[A-Za-z_][\w.]*):(?=[^\s:])", r"\1: ", text, flags=re.MULTILINE)
    text = re.sub(r"\A%YAML[^\n]*\n", "", text)
    loader_class = _loader_class()
    try:
        _check_depth(yaml.parse(text, Loader=loader_class))
        loader, documents = loader_class(text), []
        while loader.check_node():
            node = loader.get_node()
            _Size().of(node)
            documents.append(_construct(loader, node))
        return documents
    except yaml.YAMLError as error:
        problem = getattr(error, "problem", None) or type(error).__name__
        if "<document start>" in problem:
            problem = "several documents one after the other, without --- between them; join them into one"
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark is not None else ""
        raise ValueError(f"is neither JSON nor YAML ({problem}{where})") from None


def _construct(loader: Any, node: Any) -> Any:
    """The values of a document. PyYAML raises errors of any kind where a value does not fit its tag."""
    import yaml

    try:
        return loader.construct_document(node)
    except yaml.YAMLError:
        raise
    except Exception:
        wrong = "is YAML with a value that is not of the kind that its tag says, such as !!int or !!bool"
        raise ValueError(f"{wrong}; write plain numbers") from None


def _check_depth(events: Any) -> None:
    import yaml

    depth = 0
    for event in events:
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > 40:  # camera files have less than ten
                raise InputError("is YAML nested too deeply for a camera file")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


class _Size:
    """Size of the nodes of a document with its aliases expanded, which are nodes that stand in several places."""

    def __init__(self) -> None:
        self._sizes: dict[int, int | None] = {}  # by id of the node; None while its children are looked at

    def of(self, node: Any) -> int:
        """Count a node and all below it, each as often as aliases repeat it.

        Raises
        ------
        InputError : it is below itself, it expands to more than 100 000, or a mapping has a name twice.
        """
        if id(node) in self._sizes:
            known = self._sizes[id(node)]
            if known is None:
                raise InputError("is YAML that refers to itself, which no camera file does")
            return known
        self._sizes[id(node)] = None
        before, children = len(self._sizes), _children(node)
        size = 1 + sum(self.of(child) for child in children)
        # as many without aliases: large calibrations are long, and not refused
        if size > max(100_000, 2 * (len(self._sizes) - before) + 2):
            raise InputError("is YAML whose aliases expand to far more than the file holds; write the values out")
        self._sizes[id(node)] = size
        return size


def _children(node: Any) -> list[Any]:
    if isinstance(node.value, str):
        return []
    if node.id == "sequence":
        return list(node.value)
    twice = first_twice((key.tag, key.value) for key, _ in node.value if isinstance(key.value, str))
    if twice is not None:
        raise InputError(f"has {twice[1]!r} twice; keep one of them")
    return [part for pair in node.value for part in pair]


def _number(kind: str, loader: Any, node: Any) -> Any:
    """The number of a node; as text where YAML 1.1 has a number that no camera file means: 11:32 is 692 there, to the
    base of 60, and 0764 is 500, to the base of 8. YAML 1.2 has neither."""
    if isinstance(node.value, str) and re.match(r"[-+]?(0[0-7_]+$|[^:]*:)", node.value):
        return node.value
    return getattr(loader, f"construct_yaml_{kind}")(node)


def _loader_class() -> Any:
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
    for kind in ("int", "float"):
        loader.add_constructor(f"tag:yaml.org,2002:{kind}", partial(_number, kind))
    return loader
