"""camera.json: a camera as a native camera file; and what `slopemap camera show --json` prints."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

from slopecli.products.slopes_json import to_json
from slopecli.report.camera_summary import CameraFacts
from slopecli.types import Camera


def native_camera(camera: Camera) -> str:
    """A camera as the text of a native camera file, which reads back as the same camera."""
    return json.dumps(_keys(camera), indent=1) + "\n"  # all digits


def camera_report(facts: CameraFacts, converted: str, metadata: object = None) -> str:
    """The facts of a camera as JSON, without a final newline; names as in `CameraFacts`, null where there is no ray.

    metadata : a dataclass with what the image states, or None.
    """
    body = {field.name: getattr(facts, field.name) for field in fields(facts) if field.name != "camera"}
    body["coefficients"] = dict(facts.coefficients)
    words = {"converted": converted, "note": facts.camera.note}
    return to_json({"camera": _keys(facts.camera), **body, **words, "metadata": metadata})


def _keys(camera: Camera) -> dict[str, Any]:
    named = {key: getattr(camera, key) for key in ("width", "height", "fx", "fy", "cx", "cy")}
    model = {} if camera.model in ("pinhole", "brown") else {"model": camera.model}
    return {**named, "distortion": list(camera.distortion), **model, "source": camera.source}
