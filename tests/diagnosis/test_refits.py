"""Fits with one effect more or less, around a first fit that may have ended in the wrong place."""

from __future__ import annotations

from dataclasses import replace

import pytest

from autotune.diagnosis.baseline import begin
from autotune.diagnosis.refits import root_from
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.bias_corrected_fit import fit_inside_twin
from autotune.estimation.problem import refit
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS

DRIFT = EFFECTS["thermal_drift"]


@pytest.mark.slow
def test_a_first_fit_that_ended_in_the_wrong_place_is_made_again_from_where_a_candidate_led_it(
    short, nominal
) -> None:
    """An effect that is not there takes nothing with it; what its fit gained is the model's as it is."""
    problem, root, _, _ = begin(prepared_to_fit([short]), nominal)
    off = root.fitted.packed.p.copy()
    off[layout.VISCOUS] *= 2.0
    held = [one for one in root.free if one.slot != layout.VISCOUS]
    astray = refit(problem, Packed(off, root.fitted.packed.on), held, root.correction, 4)
    wrong = replace(root, fitted=replace(astray, free=root.fitted.free))
    p, on = root.fitted.packed.p.copy(), root.fitted.packed.on.copy()
    on[layout.flag(DRIFT.name)] = True
    drifting = fit_inside_twin(problem, Packed(p, on), list(root.free), 1, (DRIFT.name,))
    assert drifting is not None
    assert wrong.fitted.cost > 1.2 * root.fitted.cost
    found = root_from(problem, wrong, drifting)
    assert found is not None
    assert found.effects == ()
    assert not found.fitted.packed.on[layout.flag(DRIFT.name)]
    assert found.fitted.cost == pytest.approx(root.fitted.cost, rel=0.05)
    assert root_from(problem, root, drifting) is None
