"""The noise model of Box–Jenkins: whatever the search tries, its filters must not explode."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from autotune.identify.presliding import MOST_REFLECTED, stable_polynomial

reflection = st.floats(-MOST_REFLECTED, MOST_REFLECTED)


@given(reflection, reflection)
def test_every_noise_polynomial_is_stable(first: float, second: float) -> None:
    """Reflection coefficients within ±1 give roots inside the unit circle (Levinson–Durbin)."""
    assert np.all(np.abs(np.roots(stable_polynomial(first, second))) < 1.0)


@given(st.floats(-1.9, 1.9), st.floats(-0.9, 0.9))
def test_every_stable_polynomial_can_be_reached(first: float, second: float) -> None:
    """The start from an autoregression is kept as it is where it is stable."""
    if np.all(np.abs(np.roots([1.0, first, second])) < 0.95):
        np.testing.assert_allclose(
            stable_polynomial(first / (1.0 + second), second), [1.0, first, second], atol=1e-12
        )
