"""Metashape cameras."""

from pathlib import Path

import pytest
from camera_factory import METASHAPE, check_is_the_sample, refusal, write

from slopecli.io.cameras import load_camera
from slopecli.types import Camera


def test_metashape_project(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, METASHAPE))
    check_is_the_sample(camera, cx=514.5, cy=381.5)
    assert camera.source == "Metashape"
    check_is_the_sample(load_camera(f"{write(tmp_path, METASHAPE)}#M3M (12.29mm)"), cx=514.5, cy=381.5)


def test_metashape_exported_calibrations(tmp_path: Path) -> None:
    new = (
        "<calibration><projection>frame</projection><width>1000</width><height>500</height>"
        "<f>900</f><cx>3</cx></calibration>"
    )
    camera = load_camera(write(tmp_path, new))
    assert camera == Camera(1000, 500, 900, 900, 502.5, 249.5, source="Metashape")
    old = (
        "<calibration><projection>frame</projection><width>1000</width><height>500</height>"
        "<fx>900</fx><fy>901</fy><cx>503</cx><cy>250</cy><skew>0</skew></calibration>"
    )
    camera = load_camera(write(tmp_path, old))
    assert camera == Camera(1000, 500, 900, 901, 502.5, 249.5, source="Metashape")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<k1>", "<k4>0.1</k4><k1>", "k4 = 0.1 (radial distortion of order 8) is not supported"),
        ("<k1>", "<b2>0.3</b2><k1>", "b2 = 0.3 (skew) is not supported"),
        ('type="frame" class="adjusted"', 'type="fisheye" class="adjusted"', "camera type 'fisheye'"),
        ("</document>", "", "damaged XML"),
        ("calibration", "nothing", "XML without a camera"),
    ],
)
def test_metashape_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in refusal(write(tmp_path, METASHAPE.replace(old, new)))
