"""Smooth signs: odd, held at 1, steeper where narrower."""

import numpy as np
import pytest

from autotune.signals.smooth_sign import SMOOTH_SIGNS


@pytest.mark.parametrize("sign", SMOOTH_SIGNS)
def test_a_smooth_sign_is_odd_goes_through_nothing_and_is_held_at_one(sign) -> None:  # type: ignore[no-untyped-def]
    velocity = np.linspace(-3.0, 3.0, 61)
    shown = sign(velocity, 0.2)
    np.testing.assert_allclose(shown, -shown[::-1], atol=1e-12)
    assert shown[30] == pytest.approx(0.0, abs=1e-12)
    assert shown[-1] == pytest.approx(1.0, abs=1e-3)
    assert np.all(np.diff(shown) >= 0.0)
    assert np.all(np.abs(sign(velocity, 0.2)) >= np.abs(sign(velocity, 2.0)))
