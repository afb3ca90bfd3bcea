"""Figures: what they show, with units, and what they do with nothing."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import plotly.graph_objects as go
import plotly.io
import pytest

from autotune.view import figures, theme
from autotune.view.data import Comparison, Residual, Step, Trace
from autotune.view.figures.tracking import reversal_times


@pytest.fixture(scope="module")
def drawn(sampled) -> dict[str, go.Figure]:
    return {
        "steady": figures.steady_state(sampled.steady_state),
        "presliding": figures.presliding(sampled.presliding),
        "dahl": figures.dahl_curve(sampled.dahl),
        "before_after": figures.before_after(sampled.before_after),
        "convergence": figures.convergence(sampled.traces),
        "comparison": figures.measured_and_model(sampled.comparison),
        "residual": figures.residual_over_coordinate(sampled.residual),
        "staircase": figures.staircase(sampled.steps, 0.0051),
        "ranking": figures.ranking(sampled.ranks),
        "history": figures.history(sampled.history),
    }


def titles(figure: go.Figure, kind: str) -> list[str]:
    axes = figure.select_yaxes() if kind == "y" else figure.select_xaxes()
    return [axis.title.text for axis in axes if axis.title.text]


def trace(figure: go.Figure, name: str) -> go.Scatter:
    return next(t for t in figure.data if (t.name or "").startswith(name) and t.mode != "none")


def test_every_ordinate_has_a_unit(drawn) -> None:
    for name, figure in drawn.items():
        if name == "ranking":
            assert "[%]" in titles(figure, "x")[0]
            continue
        found = titles(figure, "y")
        assert len(found) == len(list(figure.select_yaxes())), name
        assert all("[" in text and "]" in text for text in found), (name, found)


def test_all_figures_share_one_theme(drawn) -> None:
    for figure in drawn.values():
        assert figure.layout.template.layout.plot_bgcolor == "white"
        assert figure.layout.template.layout.font.family == theme.FONT


def test_no_figure_is_large(drawn) -> None:
    sizes = {name: len(plotly.io.to_json(figure)) for name, figure in drawn.items()}
    # ten figures of 150 kB stay far below the 3 MB that a report may have
    assert max(sizes.values()) < 150_000, sizes


def test_steady_state_points_and_bars_are_the_data(sampled, drawn) -> None:
    points = trace(drawn["steady"], "measured")
    np.testing.assert_allclose(points.y, sampled.steady_state.torque * 1e3, rtol=1e-5)
    np.testing.assert_allclose(points.error_y.array, sampled.steady_state.torque_error * 1e3, rtol=1e-5)
    lines = [t for t in drawn["steady"].data if t.name == "model"]
    assert len(lines) == 2
    assert max(lines[0].x) < 0 < min(lines[1].x)


def test_steady_state_without_repeats_has_no_bars(sampled) -> None:
    figure = figures.steady_state(replace(sampled.steady_state, torque_error=None))
    assert trace(figure, "measured").error_y.array is None


def test_sliding_axes_show_forces(sampled) -> None:
    figure = figures.steady_state(replace(sampled.steady_state, motion_unit="m"))
    assert titles(figure, "y") == ["Force [mN]"]
    assert titles(figure, "x") == ["Velocity [m/s]"]


def test_presliding_has_a_cross_for_every_estimate(sampled, drawn) -> None:
    crosses = [t for t in drawn["presliding"].data if t.mode == "markers"]
    assert {t.name: len(t.y) for t in crosses} == dict.fromkeys(sampled.presliding.estimates, 15)
    notes = [note.text for note in drawn["presliding"].layout.annotations]
    assert any("101.0 ± 2.5 N m/rad" in note for note in notes)


def test_presliding_methods_that_differ_by_decades_stand_on_a_logarithmic_axis(sampled) -> None:
    """Figure 6 of the report that was seen, on which all but two methods lay on the abscissa."""
    decades = {"LS": [4.8e3, 5.1e3], "BJ": [111.0, 112.0]}
    figure = figures.presliding(replace(sampled.presliding, estimates=decades))
    assert figure.layout.yaxis3.type == "log"
    with_zero = figures.presliding(replace(sampled.presliding, estimates={"LS": [0.0, 111.0]}))
    assert with_zero.layout.yaxis3.type != "log"


def test_presliding_without_comparison_of_methods(sampled) -> None:
    figure = figures.presliding(replace(sampled.presliding, estimates={}, adopted=None))
    assert len(list(figure.select_yaxes())) == 2


def test_dahl_curve_reaches_both_ends(sampled, drawn) -> None:
    measured = trace(drawn["dahl"], "measured")
    assert max(measured.x) == pytest.approx(100.0, rel=1e-3)
    assert min(measured.x) == pytest.approx(-100.0, rel=1e-3)
    assert len(drawn["dahl"].layout.shapes) == 2


def test_before_after_names_the_peaks_and_marks_the_count(sampled, drawn) -> None:
    names = [t.name for t in drawn["before_after"].data]
    peak = np.abs(sampled.before_after.before.mean(axis=0)).max() * 1e3
    assert f"before: peak {peak:.2f} mrad" in names
    assert any(name.startswith("after: peak 0.") and name.endswith("mrad") for name in names)
    notes = [note.text for note in drawn["before_after"].layout.annotations]
    assert any("±1 count (126 µrad)" in note for note in notes)


def test_before_after_of_one_repeat_has_no_band(sampled) -> None:
    one = replace(
        sampled.before_after, before=sampled.before_after.before[0], after=sampled.before_after.after[:1]
    )
    figure = figures.before_after(replace(one, resolution=None))
    assert not [t for t in figure.data if t.fill]


@pytest.mark.parametrize("frequency", [1.0, 2.0])
def test_reversals_are_where_the_reference_turns(frequency: float) -> None:
    time = np.arange(1000) * 1e-3
    found = reversal_times(time, np.sin(2 * np.pi * frequency * time))
    quarters = np.arange(1, 4 * frequency, 2) / (4 * frequency)
    # the turn lies between samples: one sample either way
    np.testing.assert_allclose(found, quarters, atol=1.1e-3)


def test_reversals_of_a_trapezoid_count_a_plateau_once() -> None:
    reference = np.concatenate([np.arange(10), np.full(5, 9), np.arange(9, -1, -1)]).astype(float)
    assert len(reversal_times(np.arange(25.0), reference)) == 1
    assert reversal_times(np.arange(5.0), np.zeros(5)) == []


def test_convergence_shows_bounds_and_refinement(sampled, drawn) -> None:
    notes = [note.text for note in drawn["convergence"].layout.annotations]
    assert len(notes) == 4
    assert notes[1].startswith("coulomb")
    assert "63 … 528 mN m" in notes[1]
    refined = [t for t in drawn["convergence"].data if t.name == "after refinement"]
    assert [t.y[0] for t in refined] == pytest.approx([39.5, 272.0, 48.7, 6.7e-4])


def test_convergence_zooms_to_the_values_not_the_bounds(sampled) -> None:
    flat = Trace("coulomb", "N m", np.arange(10.0), np.full(10, 0.3), 0.0, 30.0)
    low, high = figures.convergence([flat]).layout.yaxis.range
    assert 0 < low < 300 < high < 400


def test_staircase_shows_every_fall(drawn) -> None:
    figure = drawn["staircase"]
    np.testing.assert_allclose(figure.data[0].y, [26.2, 14.1, 7.1, 6.4], rtol=1e-5)
    assert [note.text for note in figure.layout.annotations] == ["−46 %", "−50 %", "−10 %"]
    assert "torque ripple" in figure.layout.xaxis.ticktext[1]


def test_staircase_with_a_perfect_model_divides_by_nothing() -> None:
    figure = figures.staircase([Step("base", 0.0), Step("stribeck", 0.0)])
    assert figure.layout.annotations[0].text.startswith("+0")


def test_ranking_is_ordered_and_tells_who_passed(sampled, drawn) -> None:
    figure = drawn["ranking"]
    assert figure.layout.yaxis.categoryarray[-1] == "torque ripple"
    accepted = next(t for t in figure.data if t.name == "accepted")
    assert set(accepted.y) == {"torque ripple", "reversal memory"}
    assert figure.layout.xaxis.range[0] < -1.2


def test_residual_mean_follows_the_data(sampled, drawn) -> None:
    mean = trace(drawn["residual"], "mean in the bin")
    expected = 12 * np.sin(6 * mean.x) + 4 * np.sin(12 * mean.x + 1)
    # bins of 0.08 rad smooth the sixth order by about 2 % and the twelfth by 4 %; noise 0.2 mN m
    np.testing.assert_allclose(mean.y, expected, atol=1.5)


def test_opposite_errors_of_both_directions_do_not_hide_each_other() -> None:
    """40 mN m forwards and as much the other way backwards: nothing in a common mean."""
    travel = np.tile(np.linspace(-4.0, 0.0, 2000), 2)
    direction = np.repeat([1.0, -1.0], 2000)
    residual = Residual("travel_since_reversal", "log10 rad", travel, 0.04 * direction, direction=direction)
    figure = figures.residual_over_coordinate(residual)
    means = {str(one.name): np.asarray(one.y) for one in figure.data if str(one.name).startswith("mean")}
    assert set(means) == {"mean forwards", "mean backwards"}
    np.testing.assert_allclose(means["mean forwards"], 40.0, rtol=1e-6)  # mN m
    np.testing.assert_allclose(means["mean backwards"], -40.0, rtol=1e-6)
    assert figure.layout.xaxis.type == "log"
    assert np.asarray(figure.data[0].x).min() == pytest.approx(1e-4, rel=1e-3)  # rad, not its logarithm


def test_residual_ignores_what_is_not_a_number() -> None:
    values = np.array([0.0, 1.0, 2.0, np.nan, 3.0])
    figure = figures.residual_over_coordinate(Residual("time", "s", values, values))
    assert len(figure.data[0].x) == 4


def test_lines_break_where_nothing_was_recorded() -> None:
    time = np.concatenate([np.arange(5000) * 1e-3, 60 + np.arange(5000) * 1e-3])
    torque = np.sin(time)
    figure = figures.measured_and_model(Comparison(time, torque, 0.9 * torque))
    measured = trace(figure, "measured")
    gaps = np.flatnonzero(np.isnan(measured.y))
    assert len(gaps) == 1
    assert measured.x[gaps[0] - 1] < 5.0
    assert measured.x[gaps[0] + 1] >= 60.0
    joined = figures.measured_and_model(Comparison(np.tile(time[:5000], 2), torque, torque))
    assert max(trace(joined, "measured").x) == pytest.approx(9.999, abs=1e-3)


def test_figures_of_nothing_say_so(sampled) -> None:
    nothing = np.empty(0)

    def emptied(data: object) -> object:
        arrays = {f.name: nothing for f in fields(data) if isinstance(getattr(data, f.name), np.ndarray)}
        return replace(data, **arrays)

    for draw, data in (
        (figures.steady_state, sampled.steady_state),
        (figures.presliding, sampled.presliding),
        (figures.dahl_curve, sampled.dahl),
        (figures.measured_and_model, sampled.comparison),
        (figures.residual_over_coordinate, sampled.residual),
        (figures.history, sampled.history),
        (figures.before_after, sampled.before_after),
    ):
        assert draw(emptied(data)).layout.annotations[0].text
    for draw in (figures.convergence, figures.staircase, figures.ranking):
        assert draw(()).layout.annotations[0].text


def test_names_from_outside_are_escaped(sampled) -> None:
    figure = figures.staircase([Step("<b onload=x>", 1.0)])
    assert "<b onload" not in figure.layout.xaxis.ticktext[0]
