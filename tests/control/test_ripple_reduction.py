"""What of a model's ripple a drive can hold: which waves, with which loss, and what does not fit."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.control.ripple_reduction import RippleBlock, drive_values, keep, step_of, table_of, whole_steps
from autotune.core.errors import ConfigurationError
from autotune.core.ripple_parameters import (
    GAIN,
    HIGHEST_ORDER,
    LARGEST_STEP,
    ORDER,
    PHASE,
    SOURCE,
    TABLE,
    TORQUE,
)
from autotune.models.waves import Wave
from autotune_sim.own_ripple import fresh_ripple, own_ripple

TURN = 2.0 * np.pi
TEN = RippleBlock(harmonics=10, highest_order=200, has_source=True)
STEPS = RippleBlock(points=1024, highest_order=256, largest_step=127)


def waves(*orders: float, amplitude: float = 0.01) -> list[Wave]:
    return [Wave(k + 1, order, amplitude / (k + 1), 0.3 * k) for k, order in enumerate(orders)]


def played(values: dict[str, float], place: np.ndarray) -> np.ndarray:
    """What a drive plays over its own angle, as the simulated firmware does: written apart from the reduction."""
    record = fresh_ripple(0.0)
    if f"{TABLE}.0" in values:
        record["table"] = [values[f"{TABLE}.{k}"] for k in range(1024)]
        record["step"] = values[GAIN]
    else:
        for k in range(10):
            record["order"][0, k], record["phase"][0, k] = values[f"{ORDER}.{k}"], values[f"{PHASE}.{k}"]
            record["torque"][0, k] = values[f"{TORQUE}.{k}"]
        record["gain"] = values[GAIN]
    return np.array([own_ripple(record[0], float(angle)) for angle in place])


def wanted(found: dict[int, complex], place: np.ndarray) -> np.ndarray:
    return np.real(sum(wave * np.exp(1j * order * place) for order, wave in found.items()))


@pytest.mark.parametrize(("block", "loss"), [(TEN, 1e-9), (STEPS, 0.02)])
def test_the_drive_plays_the_waves_of_the_model_up_to_the_loss_that_was_predicted(
    block: RippleBlock, loss: float
) -> None:
    kept = keep(waves(7.0, 72.0, 144.0), block)
    place = np.linspace(0.0, TURN, 4001)
    model = np.sum([w.amplitude * np.sin(w.order * place + w.phase) for w in waves(7.0, 72.0, 144.0)], axis=0)
    left = played(drive_values(kept.waves, 1, block), place) - model
    share = np.std(left) / np.std(model)
    assert not kept.left_out
    assert (
        share <= loss
    )  # rounding to 1/127 of the peak, straight lines between 7 points of a wave of order 144
    assert 1.0 - kept.kept <= share + 1e-9 or block is TEN
    assert kept.kept > 1.0 - loss


def test_a_drive_that_counts_the_other_way_gets_the_waves_turned_round() -> None:
    found = keep(waves(5.0, 9.0), TEN).waves
    place = np.linspace(0.0, TURN, 500)
    assert played(drive_values(found, -1, TEN), -place) == pytest.approx(
        wanted(dict(found), place), abs=1e-12
    )


def test_what_does_not_fit_is_named_with_its_reason_and_what_it_costs() -> None:
    every = [
        *waves(*(float(n) for n in range(3, 15))),
        Wave(20, 201.0, 0.004, 0.0),
        Wave(21, 7.4, 0.003, 0.0),
    ]
    kept = keep(every, TEN)
    assert len(kept.waves) == 10
    assert {one.order for one in kept.left_out} == {201.0, 7.4, 13.0, 14.0}
    why = {one.order: one.why for one in kept.left_out}
    assert "above order 200" in why[201.0]
    assert "not whole" in why[7.4]
    assert "10 harmonics" in why[14.0]
    lost = np.sqrt(sum(one.amplitude**2 for one in kept.left_out) / sum(w.amplitude**2 for w in every))
    assert kept.kept == pytest.approx(1.0 - lost)
    assert "left out: order 201" in kept.in_words()


def test_a_table_that_overflows_is_refused_with_the_step_that_fits() -> None:
    torque = table_of({12: 0.02 + 0j}, 1024)
    fits = step_of(torque, STEPS)
    assert np.max(np.abs(whole_steps(torque, fits, STEPS))) == 127
    with pytest.raises(ConfigurationError, match=rf"128 steps.*at most 127; with a step of {fits:.4g}"):
        whole_steps(torque, fits * 127.0 / 128.2, STEPS)


def test_eleven_harmonics_and_an_order_of_201_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"11 harmonics.*10 harmonics up to order 200"):
        drive_values(dict.fromkeys(range(1, 12), 0.01 + 0j), 1, TEN)
    with pytest.raises(ConfigurationError, match="order 201"):
        drive_values({201: 0.01 + 0j}, 1, TEN)


def test_what_a_drive_can_hold_is_read_from_its_parameters() -> None:
    assert RippleBlock.of({"feedforward.coulomb": 0.1}) is None
    harmonics = {f"{stem}.{k}": 0.0 for stem in (ORDER, PHASE, TORQUE) for k in range(10)}
    found = RippleBlock.of({**harmonics, GAIN: 1.0, SOURCE: 0.0, HIGHEST_ORDER: 200.0})
    assert found == TEN
    table = {f"{TABLE}.{k}": 0.0 for k in range(1024)}
    assert RippleBlock.of({**table, GAIN: 0.0, LARGEST_STEP: 127.0}) == STEPS
