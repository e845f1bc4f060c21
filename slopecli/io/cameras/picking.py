"""Which of several cameras of a file is meant: by the name given, or by the path of the image."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import PurePath

from slopecli.errors import InputError

ID = re.compile("0|[1-9][0-9]*")


def named(cameras: Collection[str], name: str) -> str:
    """The camera of this name: the whole name, or the end of a path (`0001.png`, `cam0/0001.png`).

    Raises
    ------
    InputError : there is none, or several; the message lists the names there are.
    """
    if name in cameras:
        return name
    ends = [one for one in cameras if _parts(name) and _common_end(one, name) == len(_parts(name))]
    if len(ends) == 1:
        return ends[0]
    if ends:
        raise InputError(f"has {len(ends)} cameras for {name!r}; pick one of them: {listed(ends)}")
    held = f"it holds {listed(cameras)}" if any(cameras) else "it holds one camera without a name; leave the name out"
    raise InputError(f"has no camera {name!r}; {held}")


def of_image(cameras: Collection[str], image: str, images_called: Callable[[str], str] | None = None) -> str | None:
    """The camera whose name fits the path of an image, None if none does.

    A name that is a path fits where it ends as the path of the image does; a name such as `cam0` or `left` where the
    file, or a folder that it is in, is called so.

    images_called : what the images of a camera are called, where that is not as the camera; "" for nothing else.

    Raises
    ------
    InputError : several fit equally well.
    """
    fitting = _ending_as([one for one in cameras if not ID.fullmatch(one)], image)  # ids are no names of images
    if not fitting:
        parts = _parts(image)[-4:]
        names = {one: (one, images_called(one) if images_called else "") for one in cameras}
        fitting = [one for one in cameras if any(_is_called(part, name) for part in parts for name in names[one])]
    if len(fitting) > 1:
        raise InputError(f"has {len(fitting)} cameras for this image; pick one of them with #NAME: {listed(fitting)}")
    return fitting[0] if fitting else None


def of_labelled_image(camera_by_label: Mapping[str, str], image: str) -> str | None:
    """The camera of the image whose label, a path or the end of one, fits the path of an image; None if none does.

    Raises
    ------
    InputError : labels of images of several cameras fit equally well.
    """
    fitting = list(dict.fromkeys(camera_by_label[label] for label in _ending_as(camera_by_label, image)))
    if len(fitting) > 1:
        raise InputError(f"has images called so of {len(fitting)} cameras; pick one with #NAME: {listed(fitting)}")
    return fitting[0] if fitting else None


def stem_of(path: str) -> str:
    """The last part of a path without its suffix."""
    return PurePath(path.replace("\\", "/")).stem


def _ending_as(names: Iterable[str], path: str) -> list[str]:
    """Those names that have the most parts in common with the end of a path."""
    ends = {name: _common_end(name, path) for name in names}
    longest = max(ends.values(), default=0)
    return [name for name, length in ends.items() if length == longest > 0]


def listed(names: Iterable[str]) -> str:
    """The first names, for a message."""
    names = list(names)
    return ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")


def _parts(path: str) -> list[str]:
    return [part for part in path.replace("\\", "/").split("/") if part not in ("", ".", "..")]


def _common_end(name: str, path: str) -> int:
    """How many parts two paths have in common at their ends; a suffix counts only where both have one."""
    ours, theirs = _parts(name), _parts(path)
    if not ours or not theirs:
        return 0
    if "." not in ours[-1] or "." not in theirs[-1]:
        ours[-1], theirs[-1] = PurePath(ours[-1]).stem, PurePath(theirs[-1]).stem
    length = 0
    for one, other in zip(reversed(ours), reversed(theirs), strict=False):
        if one != other:
            break
        length += 1
    return length


def _is_called(part: str, name: str) -> bool:
    """Whether a camera's name stands alone in a part of a path: cam0 in cam0_17, left in left01."""
    if len(name) < 3 or not name[0].isalpha():
        return False
    ends_in_digit = name[-1].isdigit()
    after = "(?![a-z0-9])" if ends_in_digit else "(?![a-z])"
    return re.search(rf"(?<![a-z0-9]){re.escape(name.lower())}{after}", part.lower()) is not None
