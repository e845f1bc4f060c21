"""Steps of dense depth that the window of the alignment misplaced are put back where the images have them."""

import numpy as np

from slopecli.look import Edges

SIDE, EDGE, MISPLACED = 96, 40, 6  # px
NEAR, FAR = 0.0, -0.2  # logarithms of inverse depth on the left of the edge and on its right
SHIFT_PX = 100.0  # displacement per change of the logarithm


def misplaced(texture: float = 20.0, edge: int = EDGE):
    """Grey values, the logarithm measured, image 2 resampled by it, and grey values of image 2 at other logarithms."""
    rng = np.random.default_rng(7)
    grey, elsewhere = (100.0 + texture * rng.standard_normal((2, SIDE, SIDE))).astype(np.float32)
    truth = np.where(np.arange(SIDE) < EDGE, NEAR, FAR).astype(np.float32) * np.ones((SIDE, 1), np.float32)
    measured = np.roll(truth, edge - EDGE, axis=1)
    measured[:, :edge], measured[:, edge:] = NEAR, FAR
    noise = rng.standard_normal((SIDE, SIDE)).astype(np.float32)

    def grey2(at, logarithm):
        return np.where(logarithm == truth.ravel()[at], (grey + noise).ravel()[at], elsewhere.ravel()[at])

    every = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    return truth, grey, measured, grey2(every, measured), grey2


def settled(grey, measured, pulled, grey2):
    step = np.zeros(measured.shape, bool)
    step[:, 1:] = np.diff(measured, axis=1) != 0
    return Edges(step, np.full(measured.shape, SHIFT_PX, np.float32), 10, 1.0).settled(measured, grey, pulled, grey2)


def test_a_surface_that_grew_over_the_farther_one_is_cut_back():
    truth, grey, measured, pulled, grey2 = misplaced(edge=EDGE + MISPLACED)
    before = (measured != truth).mean()
    logarithm, resampled = settled(grey, measured, pulled, grey2)
    assert (logarithm != truth).mean() < 0.05 * before
    assert np.abs(resampled - grey).max() < np.abs(pulled - grey).max() + 1e-3
    assert np.median(np.abs(resampled - grey)[:, EDGE : EDGE + MISPLACED]) < 2.0  # noise, not another texture


def test_a_farther_surface_that_grew_is_cut_back_too():
    truth, grey, measured, pulled, grey2 = misplaced(edge=EDGE - MISPLACED)
    logarithm, _ = settled(grey, measured, pulled, grey2)
    assert (logarithm != truth).mean() < 0.05 * (measured != truth).mean()


def test_a_step_in_its_place_stays():
    truth, grey, measured, pulled, grey2 = misplaced()
    logarithm, _ = settled(grey, measured, pulled, grey2)
    assert (logarithm != truth).sum() <= 2 * SIDE * 0.02


def test_ground_without_steps_is_left_as_it_is():
    _, grey, measured, pulled, grey2 = misplaced()
    level = np.full_like(measured, NEAR)
    logarithm, resampled = settled(grey, level, pulled, grey2)
    assert logarithm is level
    assert resampled is pulled


def test_blank_ground_keeps_its_side():
    _, grey, measured, _, _ = misplaced(texture=0.0, edge=EDGE + MISPLACED)
    logarithm, _ = settled(grey, measured, grey, lambda at, _: grey.ravel()[at])
    assert np.array_equal(logarithm, measured)
