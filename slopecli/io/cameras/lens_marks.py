"""Which lens model a tree of names and values marks its camera with, under the names in use for such marks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Literal

from slopecli.errors import InputError
from slopecli.io.cameras.values import LENSES_KNOWN, Tree, lens_model, plain_key
from slopecli.types import CameraModel

OF = "camera|cam|lens|distortion|dist|distort|projection|proj|intrinsics?|calibration|calib|undistortion"
NAMED = re.compile(
    rf"(?:{OF})?(?:{OF})?(?:model|modeltype|modelname|type)|(?:cam|camera)?lens|lenses|lens(?:mode|kind)|"
    "(?:lens)?projection|optics|distortionname"
)
SWITCH = re.compile("(?:is|use|has|using|with)?(?:fisheye|fisheyed)(?:model|lens|camera|cam|flag|mode|distortion)?")
# words that tell of a lens other than a radial-tangential one, wherever they stand
SUSPECT = "fish.?eye|equi.?dist|kannala|omni|equi.?rect|spheric|double.?sphere|unified|f.?theta|eucm|panoram"
PROSE = re.compile(".*(?:name|comment|note|description|source|time|date|file|path|author|title|topic|label|serial|id)")


def marked_model(tree: Tree) -> CameraModel | None:
    """The lens model that a camera is marked with, None where it has no mark.

    Raises
    ------
    InputError : a mark is not understood, or two contradict each other.
    """
    marks = dict(_marks(tree))
    switches = {key for key, model in marks.items() if model == "other"}
    models = {model for model in marks.values() if model != "other"}
    # "pinhole" names the projection, beside which another mark names the distortion
    strong = models - {"pinhole"} or models
    if len(strong) > 1 or (switches and "fisheye" in models):
        said = " and ".join(f"{key!r} ({'not fisheye' if model == 'other' else model})" for key, model in marks.items())
        raise InputError(f"{said} contradict each other; keep one of them")
    return next(iter(strong), None)


def is_mark_key(key: Any) -> bool:
    """Whether a key is one under which lens models are marked."""
    plain = plain_key(key)
    return bool(NAMED.fullmatch(plain) or SWITCH.fullmatch(plain))


def _marks(tree: Tree, level: int = 0) -> Iterator[tuple[str, CameraModel | Literal["other"]]]:
    """Every mark: its key and the model, or "other" where a switch says that it is no fisheye lens."""
    for key, value in tree.items():
        plain = plain_key(key)
        if isinstance(value, Mapping) and not SWITCH.fullmatch(plain):
            if level < 3:
                yield from _marks(value, level + 1)
        elif SWITCH.fullmatch(plain):
            yield str(key), _switched(str(key), value)
        elif plain == "type":
            if isinstance(value, str) and (_is_known(value) or re.search(SUSPECT, value, re.IGNORECASE)):
                yield str(key), lens_model(value, str(key))
        elif NAMED.fullmatch(plain):
            if value is not None:
                yield str(key), _named(str(key), value)
        else:
            _refuse_suspect(str(key), plain, value)


def _named(key: str, value: Any) -> CameraModel:
    if not isinstance(value, str):
        raise InputError(f"{key!r} is {_shown(value)}, needed the name of a lens model: {LENSES_KNOWN}")
    return lens_model(value, key)


def _switched(key: str, value: Any) -> CameraModel | Literal["other"]:
    word = str(int(value)) if isinstance(value, float) and value in (0, 1) else str(value).strip().lower()
    if word in ("true", "1", "yes", "on", "y"):
        return "fisheye"
    if word in ("false", "0", "no", "off", "n", "none", "null", ""):
        return "other"
    if isinstance(value, str):
        return lens_model(value, key)
    raise InputError(f"{key!r} is {_shown(value)}, needed true or false")


def _is_known(name: str) -> bool:
    try:
        lens_model(name)
    except InputError:
        return False
    return True


def _refuse_suspect(key: str, plain: str, value: Any) -> None:
    """Refuse what may be a mark of another lens under a name that is not read."""
    if PROSE.fullmatch(plain) or value is None or value is False:
        return
    if (
        isinstance(value, str)
        and "fisheye" in plain
        and value.strip().lower() in ("", "0", "false", "no", "none", "off")
    ):
        return
    says = isinstance(value, str) and re.search(SUSPECT, value, re.IGNORECASE)
    if says or (isinstance(value, bool | int | float | str) and value and re.search(SUSPECT, plain)):
        raise InputError(f"{key!r} = {_shown(value)} is not understood; name the lens as model, for example fisheye")


def _shown(value: Any) -> str:
    return repr(value)[:60]
