"""Cameras of MATLAB: structs of the Computer Vision Toolbox (JSON or .mat), and Bouguet's Calib_Results (.m or .mat).

Source: MathWorks, "cameraParameters" and "cameraIntrinsicsToOpenCV": the toolbox counts pixels from 1, ImageSize has
the rows first, and IntrinsicMatrix is the transpose of K. Bouguet, "Camera Calibration Toolbox": cc counts from 0, and
u = fc(1) (x_d + alpha_c y_d) + cc(1).
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.sizes import image_size
from slopecli.types import Camera

ASSIGNED = re.compile(r"^[ \t]*(\w+)[ \t]*=[ \t]*(\[[^\]]*\]|[-+.\deE]+)", re.MULTILINE)
BOUGUET = re.compile(r"(fc|cc|kc|alpha_c)(_left|_right)?")
TOOLBOX = {"RadialDistortion", "TangentialDistortion"}
SAVE = "save it as save(FILE, '-struct', 'S', '-v7') with S = toStruct(cameraParams), or as jsonencode(S)"


def find(content: CameraFileContent) -> dict[str, values.Tree]:
    """Cameras by the names of their structs, or left and right; {} for another format."""
    tree = _variables(content)
    if tree is None:
        return {}
    structs = _structs_in(tree)
    for struct in tuple(structs.values()):  # of a stereo pair, one level further down
        structs |= _structs_in(struct)
    if any("MappingCoefficients" in struct for struct in (tree, *structs.values())):
        raise InputError("MATLAB's fisheyeParameters (Scaramuzza's polynomial) are not supported; undistort first")
    if set(tree) >= TOOLBOX:
        return {"": tree}
    found = {name: struct for name, struct in structs.items() if set(struct) >= TOOLBOX}
    if found:
        return found if len(found) > 1 else {"": next(iter(found.values()))}
    names = {match[2] or "" for match in map(BOUGUET.fullmatch, map(str, tree)) if match and match[1] == "fc"}
    return {name.lstrip("_"): _without(tree, name) for name in sorted(names)}


def _structs_in(tree: values.Tree) -> dict[str, values.Tree]:
    return {str(key): value for key, value in tree.items() if isinstance(value, Mapping)}


def _without(tree: values.Tree, suffix: str) -> values.Tree:
    """The variables with a suffix, without it, and those without one that all cameras share."""
    own = {key: value for key, value in tree.items() if suffix and str(key).endswith(suffix)}
    return {**tree, **{key.removesuffix(suffix): value for key, value in own.items()}}


def _variables(content: CameraFileContent) -> values.Tree | None:
    if content.data.startswith(b"MATLAB 7.3") or content.data.startswith(b"\x89HDF"):
        raise InputError(f"is a MATLAB file of version 7.3, which is not read; {SAVE}")
    if content.data.startswith(b"MATLAB 5.0 MAT-file"):
        return _of_mat_file(content.data)
    if content.is_binary:
        return None
    if re.search(r"^[ \t]*fc(_left|_right)?[ \t]*=[ \t]*\[", content.text[:100_000], re.MULTILINE):
        return _of_script(content.text[:100_000])
    if "RadialDistortion" not in content.text and "MappingCoefficients" not in content.text:
        return None
    return content.tree


def _of_script(text: str) -> dict[str, Any]:
    """Numbers assigned in a script."""
    text = re.sub(r"%[^\n]*", "", text)
    pairs = [(name, re.split(r"[\s,;]+", value.strip("[] \t\r\n;,"))) for name, value in ASSIGNED.findall(text)]
    values.refuse_twice(name for name, _ in pairs if BOUGUET.fullmatch(name))
    return {name: parts if len(parts) > 1 else parts[0] for name, parts in pairs}


def _of_mat_file(data: bytes) -> dict[str, Any]:
    """Names and values of the small variables of a .mat of version 5 to 7."""
    from io import BytesIO

    from scipy.io import loadmat

    try:
        loaded = loadmat(BytesIO(_small_variables(data)), simplify_cells=True)
        tree = {key: _plain(value) for key, value in loaded.items() if not key.startswith("__")}
    except Exception:  # SciPy raises many kinds of exceptions on damaged bytes
        raise InputError("is a damaged MATLAB file") from None
    if any(value == "an object" for value in tree.values()) and not any(BOUGUET.fullmatch(key) for key in tree):
        raise InputError(f"holds an object of MATLAB, which only MATLAB can read; {SAVE}")
    return tree


def _small_variables(data: bytes) -> bytes:
    """The file without the variables of more than 100 kB, and without compression."""
    kept, place = [data[:128]], 128
    while place + 8 <= len(data):
        kind, size = (int.from_bytes(data[place + k : place + k + 4], "little") for k in (0, 4))
        element = data[place : place + 8 + size]
        if kind == 15:  # compressed
            element = zlib.decompressobj().decompress(element[8:], 100_001)
        if len(element) <= 100_000:
            kept.append(element)
        place += 8 + size
    return b"".join(kept)


def _plain(value: Any) -> Any:
    """Lists, numbers, texts and mappings in place of NumPy's and SciPy's."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if type(value).__name__ == "MatlabOpaque" or getattr(getattr(value, "dtype", None), "names", None):
        return "an object"
    return value.tolist() if hasattr(value, "tolist") else value


def read(tree: values.Tree, image: values.Size | None) -> Camera:
    """Coefficients are in OpenCV's order; skew is kept."""
    return _bouguet(tree, image) if "fc" in tree else _toolbox(tree, image)


def _bouguet(tree: values.Tree, image: values.Size | None) -> Camera:
    for key in ("cc", "kc"):
        if key not in tree:
            raise InputError(f"{key} is missing; Calib_Results has fc, cc, alpha_c and kc")
    focal, centre = (values.numbers(tree[key], key) for key in ("fc", "cc"))
    if len(focal) != 2 or len(centre) != 2:
        raise InputError(f"fc and cc have {len(focal)} and {len(centre)} numbers, needed two each")
    skew = values.numbers(tree.get("alpha_c", 0), "alpha_c")
    own = values.size_of(tree.get("nx"), tree.get("ny"))
    lens = values.with_skew(values.numbers(tree["kc"], "kc"), skew[0] if skew else 0.0)
    return values.make_camera(
        "MATLAB, Bouguet's toolbox", own or image, (*focal, *centre), *lens, size_given=own is not None
    )


def _toolbox(tree: values.Tree, image: values.Size | None) -> Camera:
    fx, fy, cx, cy, skew = _intrinsics(tree)
    radial = values.numbers(tree["RadialDistortion"], "RadialDistortion")
    tangential = values.numbers(tree["TangentialDistortion"], "TangentialDistortion")
    if len(radial) not in (2, 3) or len(tangential) != 2:
        raise InputError(
            f"RadialDistortion and TangentialDistortion have {len(radial)} and {len(tangential)} numbers, needed 2 or "
            "3 and 2"
        )
    inner = tree.get("Intrinsics")
    size = tree.get("ImageSize") or (inner.get("ImageSize") if isinstance(inner, Mapping) else None)
    stated = {"shape": size} if size else {}  # rows first
    own, _ = image_size(stated, (cx, cy), image)
    note = ""
    if own and values.numbers(size, "ImageSize") == [*own] and own[0] != own[1]:
        note = (
            f"ImageSize {own[0]:g} {own[1]:g} has the rows first in MATLAB, but by the principal point it is the width"
        )
    lens = values.with_skew([*radial[:2], *tangential, *radial[2:]], skew / fx if fx else 0.0)
    return values.make_camera(
        "MATLAB", own or image, (fx, fy, cx - 1.0, cy - 1.0), *lens, note=note, size_given=own is not None
    )


def _intrinsics(tree: values.Tree) -> tuple[float, float, float, float, float]:
    """fx, fy, cx, cy and the skew, as the toolbox counts pixels; an object as JSON has them below Intrinsics."""
    inner = tree.get("Intrinsics")
    tree = {**inner, **tree} if isinstance(inner, Mapping) else tree
    if "IntrinsicMatrix" in tree:
        k = values.numbers(tree["IntrinsicMatrix"], "IntrinsicMatrix")
        if len(k) == 9 and k[6:8] == [0, 0] and (k[2] or k[5]):
            raise InputError("IntrinsicMatrix is not the transpose of K that MATLAB writes; call it K, or transpose it")
        return values.skewed_intrinsics([k[place::3] for place in range(3)], "IntrinsicMatrix")
    if "K" in tree:
        return values.skewed_intrinsics(tree["K"], "K")
    if "FocalLength" not in tree or "PrincipalPoint" not in tree:
        raise InputError("IntrinsicMatrix, K, or FocalLength and PrincipalPoint are missing")
    focal, centre = (values.numbers(tree[key], key) for key in ("FocalLength", "PrincipalPoint"))
    if len(focal) not in (1, 2) or len(centre) != 2:
        raise InputError(f"FocalLength and PrincipalPoint have {len(focal)} and {len(centre)} numbers, needed two each")
    return focal[0], focal[-1], centre[0], centre[1], values.number(tree.get("Skew") or 0, "Skew")
