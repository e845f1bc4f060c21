"""Agisoft Metashape (PhotoScan) XML: an exported calibration, or the sensors of a project.

Source: Metashape user manual, appendix "Camera models": u = w/2 + cx + x' f + x' b1 + y' b2, v = h/2 + cy + y' f.
Pixel centres are at (0.5, 0.5), P1 and P2 are exchanged compared with OpenCV, and K4 is of order 8 in the radius, or of
order 9 in the angle of a fisheye lens.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import Beside, CameraFileContent
from slopecli.types import Camera, CameraModel

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

BEFORE = "its calibration is the initial one, of before the cameras were aligned"


def find(content: CameraFileContent) -> dict[str, Element]:
    """Calibrations by the label (or id) of their sensor, "" for an exported calibration; {} for another format."""
    root = content.xml
    if root is None:
        return {}
    if root.tag == "calibration":
        return {"": root}
    found: dict[str, Element] = {}
    for name, sensor in _sensors(root).items():
        # the result of the bundle adjustment is preferred to its initial value
        calibrations = sensor.findall("calibration")
        found[name] = next((c for c in calibrations if c.get("class") == "adjusted"), calibrations[0])
    return found


def _sensors(root: Element) -> dict[str, Element]:
    """Sensors with a calibration by their label, or their id."""
    found: dict[str, Element] = {}
    for sensor in root.iter("sensor"):
        if sensor.find("calibration") is not None:
            label = sensor.get("label") or sensor.get("id") or str(len(found))
            found[label if label not in found else f"{label} {sensor.get('id')}"] = sensor
    return found


def labelled_images(content: CameraFileContent, _beside: Beside) -> dict[str, str]:
    """Sensor of every image by the image's label; an id that two sensors have, of two chunks, tells none."""
    root = content.xml
    if root is None:
        return {}
    names: dict[str | None, list[str]] = {}
    for name, sensor in _sensors(root).items():
        names.setdefault(sensor.get("id"), []).append(name)
    images = [(camera.get("label"), names.get(camera.get("sensor_id"), [])) for camera in root.iter("camera")]
    return {label: sensors[0] for label, sensors in images if label and len(sensors) == 1}


def read(calibration: Element, size: values.Size | None) -> Camera:
    """Frame cameras, also with k4 and b2, and fisheye cameras without tangential distortion and b2."""
    tags: dict[str, Any] = {child.tag: (child.text or "").strip() for child in calibration}
    values.refuse_twice(child.tag for child in calibration)
    kind = calibration.get("type") or tags.get("projection") or "frame"
    if kind not in ("frame", "fisheye"):
        raise InputError(f"Metashape camera type {kind!r} is not supported, only 'frame' and 'fisheye' are")
    values.refuse_unread_distortion(tags, (), "needed k1, k2, k3, p1, p2 as Metashape writes them")
    values.refuse_nonzero(tags, ("p3", "p4"), "tangential distortion of higher order")
    if kind == "fisheye":
        values.refuse_nonzero(tags, ("p1", "p2", "b2", "skew"), "tangential distortion or skew of a fisheye lens")
    resolution = calibration.find("resolution")
    sides = tags if resolution is None else resolution
    own = values.size_of(sides.get("width"), sides.get("height"))
    size = values.known_size(own or size)
    intrinsics = _intrinsics(tags, size)
    lens = _lens(tags, kind, intrinsics[0])
    note = BEFORE if calibration.get("class") == "initial" else ""
    return values.make_camera("Metashape", size, intrinsics, *lens, note=note, size_given=own is not None)


def _lens(tags: dict[str, Any], kind: str, fx: float) -> tuple[CameraModel, tuple[float, ...]]:
    names = ("k1", "k2", "k3", "k4", "p1", "p2", "skew" if "fx" in tags else "b2")
    k1, k2, k3, k4, p1, p2, skew = (values.number(tags.get(name) or 0, name) for name in names)
    if kind == "fisheye":
        return "fisheye", (k1, k2, k3, k4)
    return "polynomial", (k1, k2, p2, p1, k3, k4, skew / fx if fx else 0.0)


def _intrinsics(tags: dict[str, Any], size: values.Size) -> values.Intrinsics:
    if "fx" in tags:  # before version 1.2.5 the centre was absolute
        fx, fy, cx, cy = (values.number(tags.get(key), key) for key in ("fx", "fy", "cx", "cy"))
        return fx, fy, cx - 0.5, cy - 0.5
    f, b1, cx, cy = (values.number(tags.get(key) or 0, key) for key in ("f", "b1", "cx", "cy"))
    values.refuse_off_middle((cx, cy), size, "Metashape's cx and cy are measured from there: are these from a corner?")
    return f + b1, f, size[0] / 2 + cx - 0.5, size[1] / 2 + cy - 0.5
