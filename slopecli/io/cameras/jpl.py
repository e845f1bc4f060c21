"""CAHV, CAHVOR and CAHVORE models in labels of JPL's Mars images: PDS3, PDS4 and VICAR.

Source: Yakimovsky and Cunningham 1978, Gennery 2006. With `u = P.H / P.A`, fx = |A x H| and cx = A.H; pixel centres are
at integers. The camera axes are z along A, y along the part of V across A. The radial terms are about O.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.cahvor import angles_off_axis
from slopecli.geometry.camera import rays_from_pixels
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.look.noise import OVERVIEW_CELL_PX
from slopecli.types import Camera, FloatArray

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

GROUPS = (
    re.compile(r"^[ \t]*(?:GROUP|OBJECT)\s*=\s*\"?(\w*GEOMETRIC_CAMERA_MODEL\w*)\"?", re.MULTILINE),
    re.compile(r"PROPERTY\s*=\s*'(\w*GEOMETRIC_CAMERA_MODEL\w*)'"),
)
GROUP_ENDS = re.compile(r"\bEND_(?:GROUP|OBJECT)\b|\bPROPERTY\s*=|\bTASK\s*=")
PAIR = re.compile(r"(\w+)\s*=\s*(\([^()]*\)|'[^']*'|\"[^\"]*\"|[^\s,)]+)")
LETTERS = "C A H V O R E T P"
# where PDS4 has the vectors
PDS4_PARTS = {
    "C": "Vector_Center",
    "A": "Vector_Axis",
    "H": "Vector_Horizontal",
    "V": "Vector_Vertical",
    "O": "Vector_Optical",
    "R": "Radial_Terms",
    "E": "Entrance_Terms",
    "T": "cahvore_model_type",
    "P": "cahvore_model_parameter",
}
Model = dict[str, Any]  # type, size, and the components by letter, not yet checked


# nothing in focus is nearer than the first; ground nearer than the other is all that rovers and landers measure
NEAR_M = (0.05, 100.0)


def find(content: CameraFileContent) -> dict[str, Model]:
    """The models of a label by the names of their groups, "" where there is one; {} for another format."""
    if b"GEOMETRIC_CAMERA_MODEL" not in content.data and b"CAHV" not in content.data:
        return {}
    if content.is_binary:
        return {}
    models = list(_in_xml(content.xml) if content.xml is not None else _in_label(content.text))
    if len(models) == 1:
        return {"": models[0][1]}
    values.refuse_twice(name for name, _ in models)
    return dict(models)


def _in_label(text: str) -> Iterator[tuple[str, Model]]:
    """Groups of a PDS3 label, or properties of a VICAR label."""
    size = _label_size(text)
    for pattern in GROUPS:
        for start in islice(pattern.finditer(text), 50):  # labels have one or two
            body = text[start.end() : start.end() + 10_000]  # a group has a twentieth of that
            end = GROUP_ENDS.search(body)
            without_units = re.sub("<[^<>]*>", "", body[: end.start()] if end else body)
            pairs = dict(PAIR.findall(without_units))
            letters = re.findall(r"[A-Z]", pairs.get("MODEL_COMPONENT_ID", LETTERS)) or LETTERS.split()
            parts = {
                letter: re.findall(r"[^\s(),'\"<>]+", pairs[f"MODEL_COMPONENT_{k}"])
                for k, letter in enumerate(letters, 1)
                if f"MODEL_COMPONENT_{k}" in pairs
            }
            kind = re.sub(r"\W", "", pairs.get("MODEL_TYPE", ""))
            if kind:
                frame = pairs.get("REFERENCE_COORD_SYSTEM_NAME", "").strip("'\"")
                yield start[1], {"type": kind, "size": size, "frame": frame, **parts}


def _label_size(text: str) -> tuple[Any, Any]:
    image = re.search(r"^[ \t]*OBJECT[ \t]*=[ \t]*IMAGE[ \t\r]*$", text, re.MULTILINE)
    if image is not None:
        names, text = ("LINE_SAMPLES", "LINES"), text[image.end() :]
    else:
        names = ("NS", "NL")
    found = [re.search(rf"\b{name}\s*=\s*(\d{{1,9}})\b", text) for name in names]
    return (None, None) if None in found else tuple(match[1] for match in found if match)  # type: ignore[return-value]


def _in_xml(root: Element) -> Iterator[tuple[str, Model]]:
    """Models of a PDS4 label; names of elements without their namespaces."""
    sides: dict[str | None, str | None] = {}
    for axis in (element for element in root.iter() if _plain(element) == "Axis_Array"):
        named = {_plain(child): (child.text or "").strip() for child in axis}
        sides.setdefault(named.get("axis_name"), named.get("elements"))
    size = sides.get("Sample"), sides.get("Line")
    groups = (group for group in root.iter() if any(_plain(child).startswith("CAHV") for child in group))
    for k, group in enumerate(groups):
        model = next(child for child in group if _plain(child).startswith("CAHV"))
        children = {_plain(child): child for child in model}
        parts = {letter: _texts(children[name]) for letter, name in PDS4_PARTS.items() if name in children}
        frames = (one.text for one in group.iter() if _plain(one) == "coordinate_space_frame_type")
        frame = (next(frames, "") or "").strip()
        yield str(k + 1), {"type": _plain(model).partition("_")[0], "size": size, "frame": frame, **parts}


def _plain(element: Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _texts(element: Element) -> list[str]:
    """The texts of an element's children, or its own."""
    return [(child.text or "").strip() for child in element] or [(element.text or "").strip()]


def read(model: Model, image: values.Size | None) -> Camera:
    """The rays are those of the model, without a fit; a moving entrance pupil is left out, and that is said."""
    kind = model["type"]
    if kind not in ("CAHV", "CAHVOR", "CAHVORE"):
        raise InputError(f"the camera model {kind!r} is not supported, only CAHV, CAHVOR and CAHVORE are")
    A, H, V = (_vector(model, letter) for letter in "AHV")
    length = float(np.linalg.norm(A))
    if length == 0:
        raise InputError("A is zero; it must be the unit vector of the image plane's normal")
    z = A / length
    across, down = ((vector - (vector @ z) * z) / length for vector in (H, V))
    fy = float(np.linalg.norm(down))
    if fy == 0:
        raise InputError("V is parallel to A; H and V must be the image's horizontal and vertical vectors")
    y = down / fy
    x = np.cross(y, z)
    fx, cx, cy = float(across @ x), float(H @ z) / length, float(V @ z) / length
    if fx <= 0:
        raise InputError("H, V and A make a mirrored image; H must point along the lines, V down, A into the scene")
    radial, linearity = _radial_terms(model, kind)
    axis = _vector(model, "O") if kind != "CAHV" else z
    tilt = np.array([axis @ x, axis @ y, axis @ z])
    if tilt[2] <= 0:
        raise InputError("O points away from A; it must be the optical axis")
    skew = float(across @ y) / fx
    skew = skew if abs(skew) > 1e-12 else 0.0  # rounding
    lens = (*radial, *(tilt[:2] / tilt[2]).tolist(), linearity, skew)
    own = values.size_of(*model["size"])
    lens = (0.0,) * 6 + (skew,) if kind == "CAHV" else lens
    camera = values.make_camera(
        f"JPL {kind}",
        own or image,
        (fx, fy, cx, cy),
        "polynomial" if kind == "CAHV" else "cahvor",
        lens,
        note=_frame_note(model["frame"], np.array([x, y, z])),
        size_given=own is not None,
    )
    return values.noted(camera, _pupil_note(camera, _vector(model, "E")) if kind == "CAHVORE" else "")


def _frame_note(frame: str, axes: FloatArray) -> str:
    """How to give the vertical of the label's frame; axes (3, 3): rows are the camera's in that frame."""
    up = ",".join(f"{value:z.5f}" for value in -axes[:, 2])
    return f"with z of {frame[:40] or 'its frame'} downward, up is --up {up}"


def _vector(model: Model, letter: str) -> FloatArray:
    if letter not in model:
        raise InputError(f"the component {letter} of the {model['type']} model is missing")
    found = values.numbers(model[letter], letter)
    if len(found) != 3:
        raise InputError(f"the component {letter} of the {model['type']} model has {len(found)} numbers, needed 3")
    return np.array(found)


def _radial_terms(model: Model, kind: str) -> tuple[list[float], float]:
    """R0 R1 R2 and the linearity: 1 is perspective, 0 fisheye."""
    if kind == "CAHV":
        return [0.0, 0.0, 0.0], 1.0
    radial = _vector(model, "R").tolist()
    if kind == "CAHVOR":
        return radial, 1.0
    if "T" not in model:
        raise InputError("the type T of the CAHVORE model (1 perspective, 2 fisheye, 3 general) is missing")
    t = values.numbers(model["T"], "T")
    if t not in ([1], [2], [3]):
        raise InputError(f"the type T of the CAHVORE model is {model['T']}, needed 1, 2 or 3")
    if t != [3]:
        return radial, 2.0 - t[0]
    p = values.numbers(model.get("P"), "P")
    if len(p) != 1:
        raise InputError("the parameter P of the general CAHVORE model (T = 3) is missing")
    if abs(p[0]) > 1:
        raise InputError(f"the parameter P of the CAHVORE model is {p[0]:g}, needed -1 to 1")
    return radial, p[0]


def _pupil_note(camera: Camera, E: FloatArray) -> str:
    """What leaving out the moving entrance pupil does; InputError where that would matter everywhere."""
    if not E.any():
        return ""
    u, v = (np.linspace(0.0, side - 1.0, 33) for side in (camera.width, camera.height))
    rays = rays_from_pixels(camera, np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    theta = angles_off_axis(rays[np.isfinite(rays).all(axis=1)], camera.distortion)
    theta = theta[theta > 0]
    shift_m = np.abs((theta / np.sin(theta) - 1.0) * (E[0] + E[1] * theta**2 + E[2] * theta**4))
    moved_px = float((shift_m * np.sin(theta)).max(initial=0.0)) * camera.focal_px  # of a point at 1 m
    near_m = moved_px / OVERVIEW_CELL_PX  # there it moves points by as much as matches may be off
    if near_m < NEAR_M[0]:
        return ""
    what = f"its entrance pupil moves by up to {1000 * float(shift_m.max(initial=0.0)):.3g} mm along O"
    if near_m > NEAR_M[1]:
        raise InputError(
            f"{what}, which moves points nearer than {near_m:.3g} m by more than {OVERVIEW_CELL_PX:g} px; "
            "a pupil that moves so far is not supported: linearise the images to CAHV first"
        )
    return (
        f"{what}, which is left out: all rays start at C, and points nearer than {near_m:.2g} m are off by more than "
        f"{OVERVIEW_CELL_PX:g} px at the border"
    )
