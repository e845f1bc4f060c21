"""Metashape cameras."""

from pathlib import Path

import numpy as np
import pytest
from camera_factory import METASHAPE, check_is_the_sample, check_pixels, directions, fisheye_image, refusal, write

from slopecli.errors import InputError
from slopecli.io.cameras import decode_camera, load_camera
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


def test_older_calibrations_have_their_principal_point_from_the_corner(tmp_path: Path) -> None:
    """fx, fy and skew in place of f, b1 and b2; corners of pixels are at integers."""
    (x, y), r2 = directions().T, (directions() ** 2).sum(axis=1)
    text = (
        "<calibration><projection>frame</projection><width>1000</width><height>500</height><fx>900</fx><fy>901</fy>"
        "<cx>503</cx><cy>250</cy><skew>0.4</skew><k1>-0.1</k1><k2>0.02</k2><k3>0.01</k3></calibration>"
    )
    across, down = (side * (1 - 0.1 * r2 + 0.02 * r2**2 + 0.01 * r2**3) for side in (x, y))
    u, v = 503 + 900 * across + 0.4 * down, 250 + 901 * down
    check_pixels(load_camera(write(tmp_path, text)), directions(), u - 0.5, v - 0.5)


FULL = """<calibration><projection>frame</projection><width>5280</width><height>3956</height><f>3705.4</f><cx>11.67</cx>
<cy>-27.75</cy><b1>0.526</b1><b2>-0.306</b2><k1>-0.0919</k1><k2>-0.0763</k2><k3>0.1163</k3><k4>-0.0761</k4>
<p1>-0.000313</p1><p2>0.000116</p2></calibration>"""


def test_k4_and_b2_are_those_of_the_manual(tmp_path: Path) -> None:
    """The formula of the user manual, appendix "Camera models", pixel centres at (0.5, 0.5)."""
    x, y = directions(widest=0.6).T
    r2 = x * x + y * y
    g = 1 - 0.0919 * r2 - 0.0763 * r2**2 + 0.1163 * r2**3 - 0.0761 * r2**4
    p1, p2 = -0.000313, 0.000116
    across = x * g + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
    down = y * g + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
    u = 5280 * 0.5 + 11.67 + across * 3705.4 + across * 0.526 + down * -0.306
    v = 3956 * 0.5 - 27.75 + down * 3705.4
    camera = load_camera(write(tmp_path, FULL))
    check_pixels(camera, np.column_stack([x, y]), u - 0.5, v - 0.5)
    assert camera.model == "polynomial"


def test_fisheye_is_the_same_polynomial_of_the_angle(tmp_path: Path) -> None:
    x = directions(widest=1.0)
    text = (
        "<calibration><projection>fisheye</projection><width>4000</width><height>3000</height><f>1500</f><cx>5</cx>"
        "<k1>0.01</k1><k2>-0.02</k2><k3>0.003</k3><k4>-0.001</k4></calibration>"
    )
    across, down = fisheye_image(x, 0.01, -0.02, 0.003, -0.001)
    camera = load_camera(write(tmp_path, text))
    check_pixels(camera, x, 2000 + 5 + 1500 * across - 0.5, 1500 + 1500 * down - 0.5)


def test_initial_values_are_said_to_be_such(tmp_path: Path) -> None:
    initial = METASHAPE.replace('class="adjusted"', 'class="initial"')
    assert "initial" in load_camera(write(tmp_path, initial)).note


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<k1>", "<p3>0.1</p3><k1>", "p3 = 0.1 (tangential distortion of higher order) is not supported"),
        (
            'type="frame" class="adjusted"',
            'type="fisheye" class="adjusted"',
            "tangential distortion or skew of a fisheye",
        ),
        ('type="frame" class="adjusted"', 'type="spherical" class="adjusted"', "camera type 'spherical'"),
        ("<cx>3</cx>", "<cx>515</cx>", "measured from there"),  # as before version 1.2.5
        ("</document>", "", "damaged XML"),
        ("calibration", "nothing", "XML without a camera"),
    ],
)
def test_metashape_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in refusal(write(tmp_path, METASHAPE.replace(old, new)))


def test_labels_of_images_pick_the_sensor_and_it_is_said() -> None:
    second = METASHAPE[METASHAPE.index("<sensor id") : METASHAPE.index("</sensors>")]
    second = second.replace('id="0"', 'id="1"').replace("<f>810</f>", "<f>910</f>")
    images = "".join(f'<camera id="{k}" sensor_id="{k % 2}" label="{4711 + k}"/>' for k in range(4))
    project = METASHAPE.replace("</sensors>", f'{second}</sensors><cameras><group id="0">{images}</group></cameras>')
    for image, fy in (("flight/4711.JPG", 810), ("flight/4714.JPG", 910)):
        camera = decode_camera(project.encode(), "project.xml", image=image)
        assert camera.fy == fy
        assert f"is that of {image}" in camera.note
    with pytest.raises(InputError, match="holds 2 cameras"):
        decode_camera(project.encode(), "project.xml", image="flight/4715.JPG")
