"""CAHV, CAHVOR and CAHVORE models of JPL's labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from camera_factory import PDS3, PDS4, VICAR, refusal, write

from slopecli.geometry import pixels_from_rays, rays_from_pixels
from slopecli.io.cameras import load_camera
from slopecli.types import Camera

A = np.array([0.8, 0.0, 0.6])
H, V = np.array([407.2, 1210.0, 305.4]), np.array([-308.8, 0.0, 1278.4])
AXIS, R = np.array([0.806, 0.012, 0.592]), (-0.0003, -0.13, 0.18)


def axes(A: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Camera axes as rows: z along A, y along the part of V across A."""
    y = V - (V @ A) * A
    y /= np.linalg.norm(y)
    return np.array([np.cross(y, A), y, A])


def image_of(point: np.ndarray, A: np.ndarray, H: np.ndarray, V: np.ndarray, axis: np.ndarray, R: tuple) -> np.ndarray:
    """Pixels of a direction by Gennery's formula, in the frame of the label."""
    axis = axis / np.linalg.norm(axis)
    omega = point @ axis
    aside = point - omega * axis
    tau = aside @ aside / omega**2
    moved = point + (R[0] + R[1] * tau + R[2] * tau**2) * aside
    return np.array([moved @ H, moved @ V]) / (moved @ A)


def rays_in_label(camera: Camera, uv: np.ndarray, A: np.ndarray, V: np.ndarray) -> np.ndarray:
    x = rays_from_pixels(camera, uv)
    return np.column_stack([x, np.ones(len(x))]) @ axes(A, V)


UV = np.random.default_rng(2).uniform(0, 1023, (60, 2))


def test_cahvor_rays_are_exact(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, PDS3))
    assert (camera.width, camera.height, camera.source) == (1024, 1024, "JPL CAHVOR")  # not those of the request
    assert camera.fx == pytest.approx(np.linalg.norm(np.cross(A, H)))
    assert (camera.cx, camera.cy) == pytest.approx((A @ H, A @ V))
    rays = rays_in_label(camera, UV, A, V)
    there = np.array([image_of(ray, A, H, V, AXIS, R) for ray in rays])
    assert np.abs(there - UV).max() < 1e-6
    about_a = np.array([image_of(ray, A, H, V, A, R) for ray in rays])
    assert np.abs(about_a - UV).max() > 0.5  # what radial terms about A would do


def test_a_label_in_front_of_pixels_is_read(tmp_path: Path) -> None:
    image = PDS3.encode().ljust(4096, b" ") + bytes(range(256)) * 400
    assert load_camera(write(tmp_path, image)) == load_camera(write(tmp_path, PDS3, "label"))
    vicar = VICAR.encode().ljust(2048, b"\0") + bytes(range(256)) * 400
    assert load_camera(write(tmp_path, vicar)) == load_camera(write(tmp_path, VICAR, "label"))


def test_cahv_of_pds4(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, PDS4))
    assert (camera.width, camera.height, camera.model, camera.source) == (1024, 960, "pinhole", "JPL CAHV")
    rays = rays_in_label(camera, UV, A, V)
    there = np.column_stack([rays @ H, rays @ V]) / (rays @ A)[:, None]
    assert np.abs(there - UV).max() < 1e-6


def general_ray(uv: np.ndarray, linearity: float) -> np.ndarray:
    """Direction of a pixel in the frame of the label, the radial equation solved by halving intervals."""
    H, V = np.array([404.0, 480.0, 303.0]), np.array([122.6, 0.0, 693.2])
    plane = np.cross(V - uv[1] * A, H - uv[0] * A)
    plane *= np.sign(plane @ A)
    axis = AXIS / np.linalg.norm(AXIS)
    zeta = plane @ axis
    aside = plane - zeta * axis
    low, high = 0.0, 3.0
    for _ in range(100):
        chi = 0.5 * (low + high)
        value = chi * 1.0001 - 0.03 * chi**3 + 0.004 * chi**5
        low, high = (low, chi) if value > np.linalg.norm(aside) / zeta else (chi, high)
    theta = np.arctan(linearity * chi) / linearity if linearity else chi
    return np.sin(theta) * aside / np.linalg.norm(aside) + np.cos(theta) * axis


@pytest.mark.parametrize(("kind", "linearity"), [("3.0", 0.46), ("2.0", 0.0), ("1.0", 1.0)])
def test_cahvore_directions_are_exact_and_its_pupil_is_said(tmp_path: Path, kind: str, linearity: float) -> None:
    camera = load_camera(write(tmp_path, VICAR.replace("MODEL_COMPONENT_8=3.0", f"MODEL_COMPONENT_8={kind}")))
    ours = rays_in_label(camera, UV, A, np.array([122.6, 0.0, 693.2]))
    theirs = np.array([general_ray(uv, linearity) for uv in UV])
    seen = np.isfinite(ours).all(axis=1)
    assert seen.mean() > 0.9
    ours /= np.linalg.norm(ours, axis=1)[:, None]
    angle = np.linalg.norm(np.cross(ours[seen], theirs[seen]), axis=1)
    assert angle.max() * camera.focal_px < 1e-6
    assert "entrance pupil moves by up to" in camera.note
    assert "rays start at C" in camera.note


def test_a_pupil_that_moves_far_is_refused(tmp_path: Path) -> None:
    far = VICAR.replace("MODEL_COMPONENT_7=(0.0005, 0.001, -0.0002)", "MODEL_COMPONENT_7=(0.5, 1.0, 0.0)")
    assert "linearise the images" in refusal(write(tmp_path, far))
    none = VICAR.replace("MODEL_COMPONENT_7=(0.0005, 0.001, -0.0002)", "MODEL_COMPONENT_7=(0.0, 0.0, 0.0)")
    assert "pupil" not in load_camera(write(tmp_path, none)).note


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("MODEL_TYPE                       = CAHVOR", "MODEL_TYPE = PSPH", "'PSPH' is not supported"),
        ('("C","A","H","V","O","R")', '("C","A","V","H","O","R")', "mirrored"),
        ("(407.2,1210.0,305.4)", "(407.2,1210.0)", "H of the CAHVOR model has 2 numbers"),
        (
            " MODEL_COMPONENT_6                = (-0.0003,-0.13,0.18)\n",
            "",
            "component R of the CAHVOR model is missing",
        ),
        ("(0.800000,0.000000,0.600000)", "(0.0,0.0,0.0)", "A is zero"),
        ("(-308.8,0.0,1278.4)", "(0.8,0.0,0.6)", "V is parallel to A"),
        ("(0.806,0.012,0.592)", "(-0.806,0.012,-0.592)", "O points away"),
        ("(-0.0003,-0.13,0.18)", "(-0.0003,-9,0.18)", "distortion leaves only"),
        ("-0.13", "x", "needed a number"),
    ],
)
def test_jpl_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in PDS3
    assert words in refusal(write(tmp_path, PDS3.replace(old, new)))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("MODEL_COMPONENT_8=3.0", "X=1", "type T of the CAHVORE model"),
        ("MODEL_COMPONENT_8=3.0", "MODEL_COMPONENT_8=7", "needed 1, 2 or 3"),
        ("MODEL_COMPONENT_9=0.46", "X=1", "parameter P"),
        ("MODEL_COMPONENT_9=0.46", "MODEL_COMPONENT_9=46", "needed -1 to 1"),
    ],
)
def test_cahvore_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in refusal(write(tmp_path, VICAR.replace(old, new)))


def test_the_projection_is_the_inverse(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, PDS3))
    np.testing.assert_allclose(pixels_from_rays(camera, rays_from_pixels(camera, UV)), UV, atol=1e-9)


def test_units_and_a_pupil_that_hardly_moves(tmp_path: Path) -> None:
    with_units = PDS3.replace("(0.800000,0.000000,0.600000)", "(0.800000 <unit>, 0.000000 <unit>, 0.600000 <unit>)")
    assert load_camera(write(tmp_path, with_units)) == load_camera(write(tmp_path, PDS3, "plain"))
    still = VICAR.replace("MODEL_COMPONENT_7=(0.0005, 0.001, -0.0002)", "MODEL_COMPONENT_7=(-8e-09, 1e-08, -2.9e-08)")
    assert "pupil" not in load_camera(write(tmp_path, still)).note


def test_a_label_of_many_groups_takes_no_time(tmp_path: Path) -> None:
    many = "GROUP = GEOMETRIC_CAMERA_MODEL\n" * 30_000
    assert "camera that is understood" in refusal(write(tmp_path, many))


@pytest.mark.parametrize(
    ("text", "frame"), [(PDS3, "ROVER_NAV_FRAME"), (VICAR, "its frame"), (PDS4, "ROVER_NAV_FRAME")]
)
def test_the_vertical_of_the_label_is_given_in_camera_axes(tmp_path: Path, text: str, frame: str) -> None:
    note = load_camera(write(tmp_path, text)).note
    assert f"with z of {frame} downward" in note
    up = np.array([float(word) for word in note.partition("--up ")[2].split(";")[0].split(",")])
    # A = (0.8, 0, 0.6) looks 36.9 degrees down: up has -0.6 along the line of sight, and 0.8 against y
    assert up == pytest.approx([0, -0.8, -0.6], abs=1e-5)
