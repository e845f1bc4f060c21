"""docs/api.md: every public name of `import slopecli`, from docstrings and source; docs/generate.py writes it."""

from __future__ import annotations

import ast
import inspect
import textwrap
from dataclasses import is_dataclass
from typing import Any

import slopecli

HEAD = """# Python reference

Made from the docstrings by `make docs`. All names are those of `import slopecli as sm`. Frames and units:
[conventions](conventions.md); an example to run: [library.ipynb](library.ipynb).
"""


def api_reference() -> str:
    """The whole page: functions, then dataclasses, then exceptions."""
    values = [getattr(slopecli, name) for name in slopecli.__all__]
    kinds = {
        "Functions": [value for value in values if not isinstance(value, type)],
        "Classes": [value for value in values if is_dataclass(value)],
        "Exceptions": [value for value in values if isinstance(value, type) and not is_dataclass(value)],
    }
    sections = [f"## {kind}\n\n" + "\n".join(map(entry, of_kind)) for kind, of_kind in kinds.items()]
    return "\n".join([HEAD, *sections])


def entry(value: Any) -> str:
    """A function, a dataclass with its fields and methods, or an exception."""
    code = "\n".join(_fields(value) if is_dataclass(value) else _definition(value))
    text = f"### {value.__name__}\n\n```python\n{code}\n```\n\n```text\n{inspect.getdoc(value)}\n```\n"
    if not is_dataclass(value):
        return text
    members = inspect.getmembers(value, lambda one: inspect.isfunction(one) or isinstance(one, property))
    shown = [(name, one, inspect.getdoc(one)) for name, one in members if not name.startswith("_")]
    lines = [
        f"- `{name}{'' if isinstance(one, property) else '()'}`: {said.splitlines()[0]}\n"
        for name, one, said in shown
        if said
    ]
    return text + "\n" * bool(lines) + "".join(lines)


def _definition(value: Any) -> list[str]:
    """The first lines of a function as its source has them; the bases of an exception."""
    if isinstance(value, type):
        return [f"class {value.__name__}({', '.join(base.__name__ for base in value.__bases__)})"]
    source = textwrap.dedent(inspect.getsource(value))
    function: Any = ast.parse(source).body[0]
    return source.splitlines()[function.lineno - 1 : function.body[0].lineno - 1]


def _fields(kind: type) -> list[str]:
    """The fields of a dataclass as its source has them, with types, defaults and comments."""
    source = textwrap.dedent(inspect.getsource(kind))
    body: Any = ast.parse(source).body[0]
    lines = source.splitlines()
    nodes = [node for node in body.body if isinstance(node, ast.AnnAssign)]
    return [line[4:] for node in nodes for line in lines[node.lineno - 1 : node.end_lineno]]
