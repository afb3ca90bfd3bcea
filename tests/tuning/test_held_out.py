"""A motion that nothing was adapted to: inside the benchmark's own limits, and judged without mercy for doubt."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.core.axis import Axis, read_axis
from autotune.experiments.held_out import HELD_OUT, HeldOut
from autotune.experiments.path import Motion
from autotune.experiments.sines import BenchmarkSine
from autotune.tuning.proof import HeldOutError, TrackingError, harm, no_worse
from tests.end_to_end.support import EXAMPLE

RESOLUTION = 1.3e-4


def axis(amplitude: float = 0.2, frequency: float = 1.0, cycle: float = 1e-3) -> Axis:
    read = read_axis(EXAMPLE)
    benchmark = read.benchmark.model_copy(update={"amplitude": amplitude, "frequency": frequency})
    return read.model_copy(update={"benchmark": benchmark, "cycle": cycle})


@settings(max_examples=20, deadline=None)
@given(
    st.floats(0.01, 2.0),
    st.floats(0.4, 5.0),
    st.sampled_from([1e-3, 2e-3, 4e-3]),
    st.sampled_from([0.0, 0.8]),
)
def test_it_needs_nothing_that_the_benchmark_does_not_need(
    amplitude: float, frequency: float, cycle: float, smoothing: float
) -> None:
    one = axis(amplitude, frequency, cycle)
    one = one.model_copy(update={"reference": one.reference.model_copy(update={"filter": smoothing})})
    motion = Motion.of(one)
    mine, known = HeldOut(motion).needs(one.limits), BenchmarkSine(motion).needs(one.limits)
    assert mine.position_min >= known.position_min
    assert mine.position_max <= known.position_max
    assert mine.speed <= known.speed
    assert mine.acceleration <= 1.05 * known.acceleration  # whole cycles round it up


def test_the_feedforward_is_whole_where_it_is_judged_and_gone_at_both_ends() -> None:
    motion = Motion.of(axis())
    window = HeldOut(motion)
    marks = window.plan.marks
    begin, end = marks[1][0], marks[2][0]
    assert [label for _, label, _ in marks[:3]] == ["conditioning", HELD_OUT, "conditioning"]
    share = np.array([row[3] for row in window.rows])
    assert np.all(share[begin:end] > 0.999999)
    assert share[0] < 1e-3
    assert share[-1] == 0.0
    assert np.max(np.abs(np.diff(share))) < 0.02  # no blow when it comes or goes


def test_it_is_short_beside_the_proof() -> None:
    assert HeldOut(Motion.of(axis())).duration < 3.2


def errors(peak: float, rms: float, scatter: float, seed: int, count: int = 4) -> HeldOutError:
    rng = np.random.default_rng(seed)
    return HeldOutError(
        peak * (1 + scatter * rng.standard_normal(count)), rms * (1 + scatter * rng.standard_normal(count))
    )


def test_what_is_better_does_no_harm() -> None:
    assert harm(errors(2e-3, 5e-4, 0.03, 1), errors(1e-3, 3e-4, 0.03, 2), RESOLUTION, 0.99) is None


@pytest.mark.parametrize(("peak", "rms", "figure"), [(3e-3, 5e-4, "peak"), (2e-3, 8e-4, "rms")])
def test_what_is_worse_in_one_figure_is_refused_and_named(peak: float, rms: float, figure: str) -> None:
    found = harm(errors(2e-3, 5e-4, 0.02, 1), errors(peak, rms, 0.02, 2), RESOLUTION, 0.99)
    assert found is not None
    assert found[0].startswith(figure)
    assert found[2] > found[1]


def test_windows_that_scatter_too_much_to_tell_are_refused() -> None:
    """The means are equal; that a third worse is ruled out, they do not show."""
    found = [
        harm(errors(2e-3, 5e-4, 0.4, seed), errors(2e-3, 5e-4, 0.4, seed + 100), RESOLUTION, 0.99)
        for seed in range(20)
    ]
    assert sum(one is not None for one in found) >= 18


def test_windows_without_any_scatter_compare_by_their_means() -> None:
    same = errors(2e-3, 5e-4, 0.0, 1)
    assert harm(same, same, RESOLUTION, 0.99) is None
    assert harm(same, errors(4e-3, 5e-4, 0.0, 1), RESOLUTION, 0.99) is not None


def test_no_number_is_never_harmless() -> None:
    lost = HeldOutError(np.full(4, np.nan), np.full(4, np.nan))
    assert harm(errors(2e-3, 5e-4, 0.02, 1), lost, RESOLUTION, 0.99) is not None


def test_single_windows_may_be_worse_by_what_they_cannot_tell() -> None:
    before = TrackingError(2e-3, 2.2e-3, 1e-3)
    assert no_worse(before, TrackingError(2.1e-3, 2.2e-3, 1.02e-3), 0.0)
    assert not no_worse(before, TrackingError(2.5e-3, 2.6e-3, 1e-3), 0.0)
    assert not no_worse(before, TrackingError(2e-3, 2e-3, 1.2e-3), 0.0)
