"""Förstner corners and least-squares matching on images whose every pixel is known in closed form."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from slopecli.look import SEARCH_PX, correlate_windows, foerstner_corners, match_foerstner
from slopecli.types import FloatArray

Grey = NDArray[np.uint8]
SIDE = 256


def texture(A: FloatArray = np.eye(2), b: FloatArray | tuple[float, float] = (0.0, 0.0), seed: int = 0) -> FloatArray:
    """Brightness, mean 128 and sigma 35, of endless random ground at points A x + b for pixels x: waves of 6 to 50 px.

    Of a wave that is exp(i u x) exp(i v y), so that all of them are a product of two matrices.
    """
    rng = np.random.default_rng(seed)
    frequency = 2 * np.pi / rng.uniform(6, 50, 160)
    angle, phase = rng.uniform(0, 2 * np.pi, (2, 160))
    wave = frequency[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    u, v = (wave @ A).T
    columns = np.exp(1j * (u[:, None] * np.arange(SIDE) + (wave @ b + phase)[:, None]))
    rows = np.exp(1j * v[:, None] * np.arange(SIDE))
    return 128 + 35 * np.sqrt(2 / 160) * (rows.T @ columns).real


def grid(height: int = SIDE, width: int = SIDE) -> FloatArray:
    y, x = np.mgrid[:height, :width]
    return np.stack([x, y], -1).astype(float)


def to_grey(values: FloatArray) -> Grey:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def with_noise(grey: Grey, sigma: float, seed: int = 0) -> Grey:
    return to_grey(grey + sigma * np.random.default_rng(seed).standard_normal(grey.shape))


def warped_pair(A: FloatArray, shift: tuple[float, float], seed: int = 0) -> tuple[Grey, Grey, FloatArray, FloatArray]:
    """Two views of the ground with x2 = A x1 + b about the image's centre; returns A and b too."""
    middle = np.full(2, (SIDE - 1) / 2)
    b = middle - A @ middle + shift
    back = np.linalg.inv(A)
    return to_grey(texture(seed=seed)), to_grey(texture(back, -back @ b, seed)), A, b


def turn(degrees: float, scale: float = 1.0) -> FloatArray:
    a = np.radians(degrees)
    return scale * np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])


def errors(pair: tuple[Grey, Grey, FloatArray, FloatArray]) -> FloatArray:
    grey1, grey2, A, b = pair
    uv1, uv2, _ = match_foerstner(grey1, grey2)
    return np.linalg.norm(uv2 - (uv1 @ A.T + b), axis=1)


def wedges(corner: tuple[float, float], angle: float, crossing: bool, contrast: float = 130) -> Grey:
    """A corner, exact to 0.1 px: two squares that touch there (`crossing`), or one."""
    fine = 10
    at = (grid(64 * fine, 64 * fine) + 0.5) / fine - 0.5 - corner
    u, v = np.moveaxis(at @ turn(np.degrees(angle)), -1, 0)
    inside = (u > 0) == (v > 0) if crossing else (u > 0) & (v > 0)
    return to_grey(60 + contrast * inside.reshape(64, fine, 64, fine).mean((1, 3)))


@pytest.fixture(scope="module")
def ground() -> Grey:
    return to_grey(texture())


@pytest.mark.parametrize("corner", [(31.0, 32.0), (31.3, 32.4), (30.5, 33.5), (31.7, 31.1)])
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_a_crossing_of_edges_is_located_to_a_tenth_of_a_pixel(corner: tuple[float, float], angle: float) -> None:
    found = foerstner_corners(wedges(corner, angle, crossing=True), 1, 5)
    assert np.linalg.norm(found[0] - corner) < 0.1


@pytest.mark.parametrize("corner", [(31.0, 32.0), (31.3, 32.4), (30.5, 33.5), (31.7, 31.1)])
def test_a_single_corner_is_located_to_a_third_of_a_pixel(corner: tuple[float, float]) -> None:
    found = foerstner_corners(wedges(corner, 0.4, crossing=False), 1, 5)
    assert np.linalg.norm(found[0] - corner) < 0.35  # blur rounds it, always towards its inside


def test_a_straight_edge_has_no_corner() -> None:
    edge = to_grey(60 + 130 / (1 + np.exp(-(grid(64, 64) @ [0.6, 0.8] - 45))))
    assert foerstner_corners(edge, 50, 5).shape == (0, 2)


def test_corners_come_strongest_first() -> None:
    contrasts = [40, 160, 90]
    parts = [wedges((31.3, 32.4), 0.4, crossing=True, contrast=c)[12:52, 12:52] for c in contrasts]
    row = np.hstack([np.pad(part, 12, mode="edge") for part in parts])
    smooth = [c for c in foerstner_corners(row, 50, 6) if abs(c[0] % 64 - 31.3) < 1 and abs(c[1] - 32.4) < 1]
    assert [int(u // 64) for u, _ in smooth] == [1, 2, 0]


def test_corners_keep_the_limit_and_their_distance(ground: Grey) -> None:
    corners = foerstner_corners(ground, 120, 10)
    apart = np.abs(corners[:, None] - corners[None]).max(2) + 99 * np.eye(120)
    assert len(corners) == 120
    assert apart.min() > 5  # their maxima are 10 px apart


def test_equal_maxima_give_one_corner() -> None:
    symmetric = wedges((31.5, 31.5), 0.0, crossing=True)
    assert len(foerstner_corners(symmetric, 50, 6)) == 1


def test_faint_parts_of_the_image_get_their_share(ground: Grey) -> None:
    faint = ground.copy()
    faint[:, : SIDE // 2] = to_grey(128 + 0.2 * (ground[:, : SIDE // 2].astype(float) - 128))
    corners = foerstner_corners(faint, 128, 5)
    assert 0.4 < np.mean(corners[:, 0] < SIDE / 2) < 0.6


@pytest.mark.parametrize("shape", [(200, 300), (12, 200), (5, 5), (1, 1)])
def test_without_texture_there_is_nothing(shape: tuple[int, int]) -> None:
    flat = np.full(shape, 90, np.uint8)
    assert foerstner_corners(flat, 100, 5).shape == (0, 2)
    uv1, uv2, n_corners = match_foerstner(flat, flat)
    assert uv1.shape == uv2.shape == (0, 2)
    assert n_corners == (0, 0)


def test_sensor_noise_is_no_texture() -> None:
    flat = np.full((300, 300), 90, np.uint8)
    assert len(foerstner_corners(with_noise(flat, 1.5), 1000, 5)) == 0


def test_ground_seen_in_one_image_only_gives_nothing(ground: Grey) -> None:
    uv1, uv2, n_corners = match_foerstner(ground, np.full((80, 100), 90, np.uint8))
    assert uv1.shape == uv2.shape == (0, 2)
    assert n_corners[0] > 100
    assert n_corners[1] == 0


@pytest.mark.parametrize("shift", [(3.25, -2.5), (0.5, 0.0), (-40.1, 25.7)])
def test_a_shift_is_found_to_hundredths_of_a_pixel(shift: tuple[float, float]) -> None:
    error = errors(warped_pair(np.eye(2), shift))
    assert len(error) > 150
    assert np.median(error) < 0.015
    assert np.mean(error < 0.05) > 0.98


def test_noise_of_two_grey_levels_costs_hundredths_of_a_pixel() -> None:
    grey1, grey2, A, b = warped_pair(np.eye(2), (3.25, -2.5))
    error = errors((with_noise(grey1, 2.0, 1), with_noise(grey2, 2.0, 2), A, b))
    assert len(error) > 150
    assert np.median(error) < 0.05


@pytest.mark.parametrize(
    ("degrees", "scale"), [(10, 1.0), (-15, 1.0), (0, 1.2), (0, 0.8), (8, 1.2), (90, 1.0), (200, 1.4)]
)
def test_turns_and_scales_are_borne(degrees: float, scale: float) -> None:
    error = errors(warped_pair(turn(degrees, scale), (6.3, -4.8)))
    assert len(error) > 50
    assert np.median(error) < 0.02
    assert np.mean(error < 0.1) > 0.95


def test_shear_of_tilted_ground_is_followed() -> None:
    error = errors(warped_pair(np.array([[1.1, 0.12], [-0.03, 0.92]]), (2.2, 1.7)))
    assert len(error) > 100
    assert np.median(error) < 0.02


def test_gain_and_offset_of_the_grey_values_do_not_count() -> None:
    grey1, grey2, A, b = warped_pair(np.eye(2), (3.25, -2.5))
    darker = to_grey(0.5 * grey2.astype(float) + 70)
    error = errors((grey1, darker, A, b))
    assert len(error) > 150
    assert np.median(error) < 0.02


def test_images_of_several_megapixels_and_of_two_sizes_match_at_full_resolution() -> None:
    noise = np.random.default_rng(3).standard_normal((1500, 1900)).astype(np.float32)
    rough = cv2.GaussianBlur(noise, (0, 0), 2) + 5 * cv2.GaussianBlur(noise, (0, 0), 8)
    ground = to_grey(128 + 40 * rough / rough.std())
    uv1, uv2, _ = match_foerstner(ground[:1400, :1800], ground[61:, 37:1500])
    assert len(uv1) > 300
    error = np.linalg.norm(uv2 - (uv1 - [37, 61]), axis=1)
    assert np.median(error) < 0.02
    assert np.mean(error < 0.1) > 0.98


def test_different_ground_hardly_matches(ground: Grey) -> None:
    uv1, _, n_corners = match_foerstner(ground, to_grey(texture(seed=9)))
    assert len(uv1) < 0.02 * n_corners[0]


def test_same_images_same_matches() -> None:
    grey1, grey2, _, _ = warped_pair(turn(5), (3.25, -2.5))
    first, second = match_foerstner(grey1, grey2), match_foerstner(grey1, grey2)
    assert np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], second[1])
    assert np.array_equal(foerstner_corners(grey1, 50, 5), foerstner_corners(grey1, 50, 5))


def pulled_by(displacement: tuple[float, float]) -> NDArray[np.float32]:
    """The ground as it looks when everything has moved by `displacement`."""
    return texture(b=-np.array(displacement)).astype(np.float32)


@pytest.fixture(scope="module")
def corners(ground: Grey) -> FloatArray:
    found = foerstner_corners(ground, 80, 6)
    return found[((found > 20) & (found < SIDE - 21)).all(1)]


@pytest.mark.parametrize("displacement", [(0.0, 0.0), (0.3, -0.45), (1.5, 0.5), (-2.7, 2.8)])
def test_windows_show_their_displacement(ground: Grey, corners: FloatArray, displacement: tuple[float, float]) -> None:
    found, correlation, ok = correlate_windows(ground, 0.7 * pulled_by(displacement) + 20, corners)
    assert ok.mean() > 0.95
    assert correlation[ok].min() > 0.98
    assert np.median(np.abs(found[ok] - displacement)) < 0.015
    assert np.abs(found[ok] - displacement).max() < 0.06


def test_a_displacement_beyond_the_search_is_not_believed(ground: Grey, corners: FloatArray) -> None:
    found, _, ok = correlate_windows(ground, pulled_by((SEARCH_PX + 3.5, 0.0)), corners)
    assert ok.mean() < 0.05
    assert found.shape == corners.shape


def test_hidden_flat_and_outer_patches_are_not_believed(ground: Grey) -> None:
    at = np.array([[60.0, 60.0], [190.0, 60.0], [2.0, 128.0], [128.0, 190.0]])
    image1, image2 = ground.copy(), pulled_by((0.4, 0.2))
    image2[60, 66] = np.nan
    image1[40:80, 170:210] = 128
    _, correlation, ok = correlate_windows(image1, image2, at)
    assert ok.tolist() == [False, False, False, True]
    assert correlation[0] == correlation[2] == -1
    assert np.isfinite(correlation).all()


def test_no_corners_no_displacements(ground: Grey) -> None:
    displacement, correlation, ok = correlate_windows(ground, pulled_by((0.0, 0.0)), np.empty((0, 2)))
    assert displacement.shape == (0, 2)
    assert correlation.shape == ok.shape == (0,)
