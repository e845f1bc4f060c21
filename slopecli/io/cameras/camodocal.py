"""Camera files of CamOdoCal, which VINS-Mono and VINS-Fusion read.

Source: camodocal's camera models. The polynomial of KANNALA_BRANDT is theta + k2 theta^3 + k3 theta^5 + ...: its k2 is
k1 elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.sizes import image_size
from slopecli.types import Camera, CameraModel

# names of the projection's parameters and of the distortion's, as in a Camera
LENSES: dict[str, tuple[CameraModel, str, str]] = {
    "PINHOLE": ("brown", "fx fy cx cy", "k1 k2 p1 p2"),
    "PINHOLE_FULL": ("brown", "fx fy cx cy", "k1 k2 p1 p2 k3 k4 k5 k6"),
    "KANNALA_BRANDT": ("fisheye", "mu mv u0 v0", "k2 k3 k4 k5"),
}


def find(content: CameraFileContent) -> dict[str, values.Tree]:
    """The camera; its name is not used, as most files keep that of the example. {} for another format."""
    tree = content.tree
    parts = ("projection_parameters", "mirror_parameters", "poly_parameters")
    return {"": tree} if "model_type" in tree and any(part in tree for part in parts) else {}


def read(tree: values.Tree, image: values.Size | None) -> Camera:
    """Cameras with a mirror (MEI) and Scaramuzza's polynomials are refused by name."""
    kind = str(tree["model_type"]).upper()
    if kind not in LENSES:
        mirror = " (a camera with a mirror, or a lens described as one)" if kind == "MEI" else ""
        raise InputError(
            f"the CamOdoCal model {kind[:40]!r}{mirror} is not supported, only {', '.join(LENSES)} are; calibrate with "
            "KANNALA_BRANDT"
        )
    model, projection, lens = LENSES[kind]
    # KANNALA_BRANDT keeps all under one heading
    terms = {**_part(tree, "distortion_parameters"), **_part(tree, "projection_parameters")}
    wanted = [*projection.split(), *lens.split()]
    for name in wanted:
        if name not in terms:
            raise InputError(f"{name} is missing; a {kind} camera has {' '.join(wanted)}")
    for name in terms:
        if name not in wanted:
            raise InputError(f"{str(name)[:40]!r} is not a parameter of a {kind} camera, which has {' '.join(wanted)}")
    fx, fy, cx, cy, *coefficients = (values.number(terms[name], name) for name in wanted)
    own, note = image_size(tree, (cx, cy), image)
    return values.make_camera(
        "CamOdoCal", own or image, (fx, fy, cx, cy), model, coefficients, note=note, size_given=own is not None
    )


def _part(tree: values.Tree, name: str) -> values.Tree:
    part = tree.get(name) or {}
    if not isinstance(part, Mapping):
        raise InputError(f"{name} is {repr(part)[:60]}, needed names with values")
    return part
