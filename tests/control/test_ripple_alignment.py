"""Influence of trial waves on the tracking error of a loop that nobody knows: what to write, and where the zero is."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.control.ripple_alignment import align, around, held_against, lines_of, remaining, resolved
from autotune.core.errors import NotEnoughExcitation

TURN = 2.0 * np.pi
RIPPLE = {12: 0.01 * np.exp(0.7j), 30: 0.004 * np.exp(-1.9j)}
LOOP = {12: -0.02 * np.exp(0.4j), 30: -0.013 * np.exp(2.5j)}
TRIAL = {12: 0.01, 30: 0.004}


def lines(written: dict[int, complex], zero: float, sense: int) -> dict[int, tuple[complex, complex]]:
    """The error of a loop whose drive adds `written` over an angle that counts from `zero` (and turned round)."""
    found = {}
    for order, ripple in RIPPLE.items():
        wave = written.get(order, 0j)
        own = (wave if sense > 0 else wave.conjugate()) * np.exp(-1j * order * zero)
        torque = own - ripple
        found[order] = (complex(LOOP[order] * torque), complex(np.conj(LOOP[order]) * torque))
    return found


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("zero", [0.0, 0.31, 1.0])
def test_what_is_written_takes_the_ripple_away_whatever_loop_zero_and_sense(zero: float, sense: int) -> None:
    first = lines({n: a + 0j for n, a in TRIAL.items()}, zero, sense)
    second = lines({n: 1j * a for n, a in TRIAL.items()}, zero, sense)
    found = held_against(align(lines({}, zero, sense), first, second, TRIAL), RIPPLE)
    assert found.sense == sense
    assert found.left < 1e-9
    own = {n: c if sense > 0 else c.conjugate() for n, c in found.waves.items()}
    after = lines(own, zero, sense)
    assert max(abs(side) for sides in after.values() for side in sides) < 1e-12
    assert found.agreement == pytest.approx(1.0, abs=1e-3)
    assert found.ratio == pytest.approx(1.0, abs=1e-9)
    period = TURN / 6.0  # of the orders 12 and 30 together
    assert (found.zero - zero + 0.5 * period) % period - 0.5 * period == pytest.approx(0.0, abs=2e-3)


def test_a_drive_that_ignores_what_is_written_is_not_believed() -> None:
    rest = lines({}, 0.0, 1)
    with pytest.raises(NotEnoughExcitation, match="does not add what is written"):
        align(rest, rest, rest, TRIAL)
    same = lines({n: a + 0j for n, a in TRIAL.items()}, 0.0, 1)
    with pytest.raises(NotEnoughExcitation, match="quarter turn"):
        align(rest, same, same, TRIAL)


def test_a_trial_that_does_not_stand_out_of_the_noise_is_no_trial() -> None:
    first = lines({n: a + 0j for n, a in TRIAL.items()}, 0.0, 1)
    second = lines({n: 1j * a for n, a in TRIAL.items()}, 0.0, 1)
    with pytest.raises(NotEnoughExcitation, match="do not stand out"):
        align(lines({}, 0.0, 1), first, second, TRIAL, noise=1e-4)
    found = align(lines({}, 0.0, 1), first, second, TRIAL, noise=2e-5)
    assert found.weak == (30,)
    assert set(found.waves) == {12}


def test_lines_are_found_beside_a_constant_and_a_slope_and_need_a_turn() -> None:
    random = np.random.default_rng(3)
    place = np.linspace(1.0, 1.0 + TURN, 3000)
    error = 2e-3 + 1e-4 * place + np.real((3e-4 - 1e-4j) * np.exp(12j * place)) + random.normal(0, 1e-5, 3000)
    assert lines_of(place, error, [12, 30])[12] == pytest.approx(3e-4 - 1e-4j, abs=2e-6)
    with pytest.raises(NotEnoughExcitation, match="does not cover one turn"):
        lines_of(place[:1500], error[:1500], [12, 30])


def test_what_remains_is_told_as_a_share() -> None:
    influence = {12: (1.0 + 0j, 1.0 + 0j)}
    assert remaining({12: (1.0 + 0j, 1.0 + 0j)}, influence, {12: -0.9 + 0j}) == pytest.approx(0.1)


def test_a_wave_that_a_model_has_split_into_its_neighbours_is_put_where_the_axis_shows_it() -> None:
    rest = dict.fromkeys(around([72, 143, 145], 256), (1e-06 + 0j, 0.000001j))
    rest |= {72: (2e-4 + 0j, 1e-4j), 144: (3e-4j, 2e-4 + 0j)}
    model = {72: 0.01 + 0j, 143: 0.006j, 145: 0.008 + 0j}
    found = resolved(model, rest)
    assert set(found) == {72, 144}
    assert found[72] == model[72]
    assert abs(found[144]) == pytest.approx(0.01)
    assert resolved({72: 0.01 + 0j}, rest) == {72: 0.01 + 0j}
    noise = dict.fromkeys(around([25], 256), (1e-06 + 0j, 0.000001j))
    assert resolved({25: 1e-4 + 0j}, noise) == {
        25: 1e-4 + 0j
    }  # nothing stands out: left where the model has it


def test_neighbours_stay_inside_what_the_drive_holds() -> None:
    assert around([1, 200], 200) == [1, 2, 3, 198, 199, 200]
