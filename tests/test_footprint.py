"""Footprints: which pixels belong to a patch, its outline, and the label map painted from several."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.patches import paint_labels, region_footprints, window_footprint

LABELS = np.zeros((40, 60), np.int32)
LABELS[5:25, 5:35] = 1
LABELS[10:15, 10:15] = 0  # a hole
LABELS[30:38, 50:58] = 1  # a second piece
LABELS[28, 2:40] = 2  # a pixel wide


def test_a_window_covers_what_lies_within_its_outline() -> None:
    footprint = window_footprint((10, 20, 30, 40))
    inside = np.array([[9.5, 19.5], [39.49, 59.49], [20.0, 30.0]])
    outside = np.array([[9.49, 30.0], [39.5, 30.0], [20.0, 19.49], [20.0, 59.5]])
    assert footprint.covers(inside).all()
    assert not footprint.covers(outside).any()
    assert footprint.area_px == 1200
    assert footprint.bounds == (10, 20, 30, 40)


def test_labels_are_painted_on_footprints_and_later_ones_win() -> None:
    labels = paint_labels([window_footprint(w) for w in ((0, 0, 4, 3), (2, 1, 4, 4))], [7, 300], (6, 8))
    assert labels.dtype == np.uint16
    assert (labels == 7).sum() == 12 - 4
    assert (labels[1:5, 2:6] == 300).all()


def test_regions_keep_their_holes_and_pieces() -> None:
    footprints = region_footprints(LABELS, LABELS.shape)
    assert [f.area_px for f in footprints] == [(LABELS == 1).sum(), (LABELS == 2).sum()]
    assert np.array_equal(paint_labels(footprints, [1, 2], LABELS.shape), LABELS)
    hole, piece = np.array([[12.0, 12.0]]), np.array([[54.0, 34.0]])
    assert not footprints[0].covers(hole).any()
    assert footprints[0].covers(piece).all()


def test_the_polygon_is_the_outline_of_the_largest_piece() -> None:
    polygon = region_footprints(LABELS, LABELS.shape)[0].polygon_px
    assert polygon.min(0) == pytest.approx([5, 5], abs=1.5)
    assert polygon.max(0) == pytest.approx([34, 24], abs=1.5)


def test_a_region_a_pixel_wide_has_a_polygon() -> None:
    polygon = region_footprints(LABELS, LABELS.shape)[1].polygon_px
    assert len(polygon) >= 3
    assert np.ptp(polygon, axis=0) == pytest.approx([38, 1], abs=1.0)


def test_a_label_map_of_a_smaller_copy_is_enlarged() -> None:
    footprints = region_footprints(LABELS, (120, 180))
    assert footprints[0].area_px == 9 * (LABELS == 1).sum()
    assert footprints[0].covers(np.array([[3 * 20.0 + 1, 3 * 20.0 + 1]])).all()


def test_the_largest_piece_of_a_scattered_region() -> None:
    labels = np.zeros((60, 80), np.int32)
    labels[:10, :10], labels[20:40, 20:40], labels[50:60, 70:80] = 1, 1, 1
    labels[:30, 60:] = 2
    scattered, whole = region_footprints(labels, labels.shape)
    assert scattered.largest_share == pytest.approx(400 / 600)
    assert whole.largest_share == 1
