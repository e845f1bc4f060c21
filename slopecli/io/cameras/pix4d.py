"""Pix4D's .cam: the calibrated internal camera parameters, in millimetres on the sensor.

Source: Pix4D's support pages, "How are the internal and external camera parameters defined". The principal point is
measured from the upper left corner of the sensor. R1 R2 R3 T1 T2 are OpenCV's k1 k2 k3 p1 p2.
"""

from __future__ import annotations

import re
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera

HEADER = re.compile(r"^[ \t]*Pix4D camera calibration file\b[ \t]*(\S*)", re.MULTILINE)
SENSOR = re.compile(r"sensor width of\s*([-+.\deE]+)\s*x\s*([-+.\deE]+)\s*mm")
KEYS = ("F", "Px", "Py", "K1", "K2", "K3", "T1", "T2")


def find(content: CameraFileContent) -> dict[str, str]:
    """The parts of the file by the number in their header, "" where there is one; {} for another format."""
    if content.is_binary or "Pix4D camera" not in content.text:
        return {}
    headers = list(HEADER.finditer(content.text))
    if not headers:
        return {}
    ends = [header.start() for header in headers[1:]] + [len(content.text)]
    parts = [(header[1], content.text[header.end() : end]) for header, end in zip(headers, ends, strict=True)]
    if len(parts) == 1:
        return {"": parts[0][1]}
    values.refuse_twice(f"camera {name}" for name, _ in parts)
    return dict(parts)


def read(part: str, image: values.Size | None) -> Camera:
    """Pixels from millimetres by the sensor's width, which the file states, and the image's, which it does not."""
    named = _terms(part)
    sensor = SENSOR.search(part)
    if sensor is None:
        raise InputError("its line with the sensor's width and height in mm is missing; export the .cam file again")
    across, down = (values.number(side, "the sensor's size") for side in sensor.groups())
    missing = [key for key in ("F", "Px", "Py") if key not in named]
    if missing:
        raise InputError(f"{missing[0]} is missing; a .cam file has {', '.join(KEYS)}")
    focal, x, y = (values.number(named[key], key) for key in ("F", "Px", "Py"))
    if not (0 < x < across and 0 < y < down):
        raise InputError(
            f"Px = {x:g}, Py = {y:g} lie outside the sensor of {across:g}x{down:g} mm; they must be in millimetres "
            "from its upper left corner, not in pixels"
        )
    width, height = values.known_size(image)
    if abs(width * down - height * across) > 2 * max(across, down):  # within two pixels
        raise InputError(
            f"the sensor of {across:g}x{down:g} mm has not the shape of the image of {width}x{height} px; give the "
            "image as the camera stored it, neither cropped nor turned"
        )
    scale = width / across
    k1, k2, k3, p1, p2 = (values.number(named.get(key, 0), key) for key in ("K1", "K2", "K3", "T1", "T2"))
    return values.make_camera(
        "Pix4D",
        image,
        (focal * scale, focal * scale, x * scale - 0.5, y * scale - 0.5),
        "brown",
        (k1, k2, p1, p2, k3),
        size_given=False,
    )


def _terms(part: str) -> dict[str, Any]:
    """Names and values of the lines that are no comments; others than those of a perspective lens are refused."""
    lines = [line.split() for line in part.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    lines = [[line[0].capitalize(), *line[1:]] for line in lines]  # some versions write px and py
    values.refuse_twice(line[0] for line in lines)
    for line in lines:
        if line[0] not in KEYS or len(line) != 2:
            raise InputError(
                f"{' '.join(line)[:40]!r} is not of a perspective lens (F Px Py K1 K2 K3 T1 T2); Pix4D's fisheye "
                "lenses are not supported: export undistorted images"
            )
    return {line[0]: line[1] for line in lines}
