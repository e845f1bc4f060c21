"""The JSON schema of slopes.json, as shipped in the package."""

from __future__ import annotations

import json
from typing import Any

from slopecli.products.slopes_json import SCHEMA_VERSION


def load_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of slopes.json that is shipped in the package."""
    from importlib import resources

    name = f"schemas/slopes-{SCHEMA_VERSION}.schema.json"
    schema: dict[str, Any] = json.loads(resources.files("slopecli").joinpath(name).read_text("utf-8"))
    return schema
