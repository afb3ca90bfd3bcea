"""The programme that a diagnosis in doubt asks for: within a minute, within the limits, for every pair of rivals."""

from __future__ import annotations

from itertools import combinations
from typing import Any, cast

import numpy as np
import pytest

from autotune.core.errors import ConfigurationError
from autotune.experiments.deciding import EVERYTHING, LONGEST, TRAJECTORIES, deciding, trajectories_for
from autotune.experiments.path import Motion
from autotune.experiments.programmes import build
from autotune.models.look_alikes import LOOK_ALIKES
from autotune.models.table import EFFECTS, looking_alike
from tests.experiments.support import axis

PAIRS = [pair for effects in looking_alike().values() for pair in combinations(sorted(effects), 2)]


def test_every_set_of_look_alikes_has_its_trajectories() -> None:
    assert set(TRAJECTORIES) == set(LOOK_ALIKES)


@pytest.mark.parametrize("rivals", [*PAIRS[::5], (), ("thermal_drift",)], ids=str)
def test_it_takes_a_minute_at_most_and_keeps_the_limits(rivals: tuple[str, ...]) -> None:
    where = axis()
    played = deciding(Motion.of(where), rivals, np.random.default_rng(1))
    for experiment in played:
        experiment.requirements(where.limits)
    assert sum(experiment.duration for experiment in played) <= LONGEST
    names = [experiment.name for experiment in played]
    assert names[0] == "conditioning"
    assert names.count("veto") == 2
    for name in set(names) - {"conditioning"}:
        one, other = (cast(Any, experiment).positions for experiment in played if experiment.name == name)
        np.testing.assert_array_equal(one, other, "each is played twice, so that noise can be told")


def test_what_is_played_depends_on_what_is_in_doubt() -> None:
    place = trajectories_for(("torque_ripple", "spring"))
    rests = trajectories_for(("stribeck", "dwell_time_break_away"))
    assert "slow_scan" in place
    assert {"rests", "slow_triangles"} <= set(rests)
    assert trajectories_for(()) == trajectories_for(("torque_ripple", "torque_lag")) == EVERYTHING


def test_an_unknown_effect_is_named_with_those_that_there_are() -> None:
    with pytest.raises(ConfigurationError, match="no effect 'magic'"):
        trajectories_for(("magic",))
    assert len(EFFECTS) >= 16


def test_without_a_diagnosis_there_is_nothing_to_decide() -> None:
    with pytest.raises(ConfigurationError, match=r"--from diagnosis\.json"):
        build("decide", axis())
