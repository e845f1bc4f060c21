"""Public names of a package, imported when they are first used, so that importing the package stays cheap."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any


def lazy_names(package: str, names: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make the `__getattr__` and the `__dir__` of a package that publishes names of its modules.

    Parameters
    ----------
    package : the package's `__name__`.
    names : module within the package ("solver.joint", or absolute "slopecli.types") -> its public names, separated
        by spaces.
    """
    module_of = {name: module for module, listed in names.items() for name in listed.split()}

    def get(name: str) -> Any:
        """Import a public name."""
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = module_of[name]
        return getattr(
            importlib.import_module(module if module.startswith("slopecli") else f"{package}.{module}"), name
        )

    return get, lambda: sorted({*module_of, *vars(sys.modules[package])})
