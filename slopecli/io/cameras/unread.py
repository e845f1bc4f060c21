"""Formats of camera files that are not read, told by their content, so that a refusal can name them."""

from __future__ import annotations

import re

from slopecli.io.cameras.content import CameraFileContent

# what a file looks like, and what its first bytes or lines hold
BINARY = {
    "a PNG image": rb"\x89PNG",
    "a JPEG image": rb"\xff\xd8\xff",
    "a TIFF image": rb"II\*\0|MM\0\*",
    "a WebP image": rb"RIFF....WEBP",
    "a NumPy array (.npy) that is no 3x3 matrix": rb"\x93NUMPY",
    "a MATLAB file (.mat)": rb"MATLAB 5|\x89HDF",
    "a Python pickle": rb"\x80[\x02-\x05]",
    "a zip archive": rb"PK",
    "a PDF document": rb"%PDF",
}
TEXT = {
    "OCamCalib (Scaramuzza)": r"#polynomial coefficients for the (DIRECT|INVERSE)|ocam_model",
    "Basalt": r"\"camera_type\"\s*:\s*\"(ds|eucm|ucm|kb4|pinhole)\"",
    "a Bundler file": r"\A# Bundle file",
    "a Meshroom graph, not its cameras.sfm": r"\"nodeType\"\s*:",
    "a lens profile of Lensfun": r"<lensdatabase",
    "a lens profile of Adobe": r"\bstCamera:",
    "a target of Kalibr": r"^target_type:",
    "a cube of ISIS": r"\AObject = IsisCube",
    "a .cahvor file of JPL, not a label": r"^[ \t]*Model[ \t]*=[ \t]*CAHV",
    "a Pix4D file of another kind than calibrated_internal_camera_parameters.cam": r"^#Focal Length mm|^OffsetXX|"
    r"^fileName imageWidth imageHeight",
    "a BlocksExchange file of ContextCapture": r"<BlocksExchange\b",
    "metadata of RealityCapture": r"\bxcr:FocalLength35mm",
    "a calibration of MicMac": r"<CalibrationInternConique\b",
    "COLMAP's images.txt, not its cameras.txt": r"IMAGE_ID, QW",
    "a sensor of Gazebo (--fov takes its horizontal_fov, in degrees)": r"<horizontal_fov>",
    "a lens and a sensor in mm (px = mm x image width in px / sensor width in mm, see --intrinsics)": r"(?i)"
    r"\bsensor_?(width|size_h)\b",
    "a slopes.json or another result of slopemap": r"\"slopemap_version\"",
    "a web page": r"\A\s*<(!DOCTYPE html|html)",
}


def looks_like(content: CameraFileContent) -> str:
    """ ", but looks like ...", or "" where nothing is known of such files."""
    for kind, start in BINARY.items():
        if re.match(start, content.data, re.DOTALL):
            stated = "; --camera exif takes what an image states itself" if kind.endswith(" image") else ""
            return f", but looks like {kind}{stated}"
    head = content.data[:100_000].decode("latin-1")
    for kind, pattern in TEXT.items():
        if re.search(pattern, head, re.MULTILINE):
            return f", but looks like {kind}, which is not read"
    return ""
