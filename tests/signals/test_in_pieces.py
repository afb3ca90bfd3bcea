"""Pieces of a motion that are gone through side by side."""

import numpy as np

from autotune.signals.in_pieces import in_pieces


def test_pieces_give_every_row_once_and_begin_far_enough_before() -> None:
    """A motion that rests in its midst: pieces that begin there look back beyond the rest."""
    moved = np.cumsum(np.concatenate([np.full(4000, 1.0), np.zeros(500), np.full(3500, 1.0)]))
    pieces = in_pieces(moved, far=100.0, most=8, shared=8)
    assert pieces is not None
    assert pieces.begin[0] == 0
    assert pieces.end[-1] == len(moved)
    np.testing.assert_array_equal(pieces.begin[1:], pieces.end[:-1])
    np.testing.assert_array_equal(pieces.end - pieces.first, pieces.rows)
    assert np.all(moved[pieces.begin[1:] - 8] - moved[pieces.first[1:]] >= 100.0)
    assert pieces.rows < 1.5 * len(moved) / 8


def test_a_motion_that_hardly_moves_is_one_piece() -> None:
    assert in_pieces(np.linspace(0.0, 1.0, 8000), far=10.0, most=8, shared=8) is None


def test_a_short_one_too() -> None:
    assert in_pieces(np.arange(12.0), far=0.5, most=8, shared=8) is None
