"""Public names of a package, and of a report, imported when they are first used, so that importing stays cheap."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pandas import DataFrame


class ReportForms:
    """Forms of a report for other programs; what makes them (`products`) is imported when one is asked for."""

    def to_json(self) -> str:
        """The text of slopes.json, without a final newline; the same report gives the same bytes."""
        text: str = _late("slopecli.products.slopes_json", "report_to_json")(self)
        return text

    def to_dataframe(self) -> DataFrame:
        """The planes as a `pandas.DataFrame`, a row a plane; raises InputError where pandas is not installed."""
        frame: DataFrame = _late("slopecli.products.planes_frame", "report_to_dataframe")(self)
        return frame


def _late(module: str, name: str) -> Any:
    return getattr(importlib.import_module(module), name)


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
