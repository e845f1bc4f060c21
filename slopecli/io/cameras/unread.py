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
    "a NumPy array (.npy), of which one says too little": rb"\x93NUMPY",
    "a MATLAB file (.mat)": rb"MATLAB 5|\x89HDF",
    "a Python pickle": rb"\x80[\x02-\x05]",
    "a zip archive": rb"PK",
    "a PDF document": rb"%PDF",
}
TEXT = {
    "a KITTI calibration": r"^(P0|P_rect_00|K_00|calib_time): ",
    "a Middlebury calibration": r"^cam0=\[",
    "a Pix4D camera file": r"Pix4D|^#Focal Length mm|^OffsetXX|^FocalLength",
    "a bare matrix of numbers": r"\A(\s*[-+.\deE]+[ \t,;]+[-+.\deE]+[ \t,;]+[-+.\deE]+[ \t,;]*\n){3}",
    "AliceVision or Meshroom": r"\"(intrinsicId|pxFocalLength)\"",
    "OpenMVG": r"\"(ptr_wrapper|polymorphic_name)\"",
    "settings of ORB-SLAM": r"^\s*Camera\d?\.(fx|type):?",
    "CamOdoCal": r"^\s*projection_parameters:",
    "an Autoware calibration": r"^\s*CameraExtrinsicMat:",
    "a RealSense camera": r"\"ppx\"",
    "COLMAP's images.txt, not its cameras.txt": r"IMAGE_ID, QW",
    "NeRF transforms without fl_x": r"\"camera_angle_x\"",
    "a MATLAB calibration": r"RadialDistortion|^\s*fc\s*=\s*\[",
    "several cameras, each under its name with K in it": r"\"(cam\w*|left|right)\"\s*:\s*\{\s*\"K\"",
    "a slopes.json or another result of slopemap": r"\"slopemap_version\"",
    "a web page": r"\A\s*<(!DOCTYPE html|html)",
}


def looks_like(content: CameraFileContent) -> str:
    """ ", but looks like ...", or "" where nothing is known of such files."""
    for kind, start in BINARY.items():
        if re.match(start, content.data, re.DOTALL):
            return f", but looks like {kind}"
    head = content.data[:100_000].decode("latin-1")
    for kind, pattern in TEXT.items():
        if re.search(pattern, head, re.MULTILINE):
            return f", but looks like {kind}, which is not read"
    return ""
