"""Image 1 divided by its smooth gradient."""

from __future__ import annotations

import numpy as np

from slopecli.look import adaptive_threshold, connected_components, grown, smooth_gradient, without_small_pieces

GREY = np.full((120, 160), 60, np.uint8)
GREY[:, 100:] = 180
GREY[40:44, 30:34] = 250


def test_the_gradient_is_in_grey_levels_a_pixel() -> None:
    ramp = np.tile(np.arange(0, 240, 2, dtype=np.uint8), (50, 1))
    assert np.allclose(smooth_gradient(ramp)[10:-10, 10:-10], 2.0, atol=0.02)


def test_the_threshold_adapts_to_the_texture() -> None:
    rng = np.random.default_rng(0)
    weak, strong = (smooth_gradient(rng.normal(128, s, (200, 200)).clip(0, 255).astype(np.uint8)) for s in (5, 20))
    assert 3 < adaptive_threshold(strong) / adaptive_threshold(weak) < 5
    assert adaptive_threshold(np.zeros((50, 50), np.float32)) > 0


def test_two_surfaces_are_two_components_the_larger_first() -> None:
    components = connected_components(smooth_gradient(GREY), 1.0, 200)
    assert components.max() == 2
    assert components[60, 10] == 1
    assert components[60, 150] == 2
    assert (components[:, 99:101] == 0).all()


def test_small_components_are_none() -> None:
    gradient = smooth_gradient(GREY)
    assert connected_components(gradient, 1.0, 1e6).max() == 0


def test_labels_grow_as_far_as_told_each_to_the_nearest() -> None:
    labels = np.zeros((30, 40), np.int32)
    labels[:, 5], labels[:, 20] = 1, 2
    spread = grown(labels, 4.0)
    assert (spread[:, 1:10] == 1).all()
    assert (spread[:, 16:25] == 2).all()
    assert (spread[:, 10:16] == 0).all()
    assert not grown(np.zeros_like(labels), 4.0).any()


def test_small_pieces_go_and_large_ones_stay_as_they_are() -> None:
    labels = np.zeros((40, 40), np.int32)
    labels[2:20, 2:20], labels[30:33, 30:33], labels[25:40, 2:12] = 1, 1, 2
    cleaned = without_small_pieces(labels, 50)
    assert (cleaned[30:33, 30:33] == 0).all()
    cleaned[30:33, 30:33] = 1
    assert np.array_equal(cleaned, labels)
