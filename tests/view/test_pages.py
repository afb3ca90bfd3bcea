"""The pages of the viewer: what they hold, that they survive the way to the streamer, that none has an empty view."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autotune.recordings.recording import Metadata, Recording
from autotune.view import stage_pages
from autotune.view.data import Residual
from autotune.view.pages import Bars, Chart, Curve, Page, TimePlot, Words, page_from_json, page_to_json
from autotune.view.rerun_file import Shown, write_rrd
from tests.view.conftest import Sampled
from tests.view.rerun_contents import empty_views, views_of


def recording(rows: int = 2000) -> Recording:
    time = np.arange(rows) * 1e-3
    columns = {
        "time": time,
        "reference": np.sin(time),
        "position": np.sin(time) - 1e-3,
        "velocity": np.cos(time),
        "torque": 0.3 * np.sign(np.cos(3 * time)),
        "temperature": np.full(rows, 31.0),
    }
    return Recording.from_columns(
        columns, Metadata(axis="test"), np.where(time < 1.0, "approach", "benchmark")
    )


def direction(residual: Residual) -> np.ndarray:
    return np.where(np.arange(len(residual.values)) % 2 == 0, 1.0, -1.0)


def every_page(sampled: Sampled) -> list[Page]:
    """A page of every stage and of every --rrd."""
    residual, compared = sampled.residual, sampled.comparison
    residuals = [(residual, direction(residual)), (replace(residual, coordinate="time"), direction(residual))]
    regimes = [stage_pages.Bar("reversal", 0.01, "#56b4e9", "10 mN m")]
    return [
        stage_pages.fit_page(compared, sampled.steady_state, "| a | b |\n|---|---|\n| 1 | 2 |", residuals),
        stage_pages.diagnosis_page(sampled.ranks, sampled.steps, residuals, "missing: ripple", "N m", 0.004),
        stage_pages.adaptation_page(sampled.traces, "settled"),
        stage_pages.proof_page(sampled.before_after, "better"),
        stage_pages.verdict_page("# Kept", regimes, "mrad"),
        stage_pages.comparison_page(compared, residuals, regimes, "error 1 mN m"),
        stage_pages.added_page(sampled.steps, compared, compared, "| a |\n|---|", "N m", 0.004),
        stage_pages.link_page(np.arange(90) * 1e-3, np.full(90, 1e-3), 1e-3, [("jitter", 1e-5)], "90 cycles"),
    ]


def test_no_view_of_any_page_is_empty_and_everything_is_in_view(sampled: Sampled, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    pages = every_page(sampled)
    limits = {"velocity": (-2.0, 2.0), "temperature": (np.nan, 80.0), "error": (-1.0, 1.0)}
    write_rrd(path, recording(), Shown(pages=pages, limits=limits, verdict="# Kept"))
    views = views_of(path)
    # traces: error, position, torque, velocity, temperature, experiments, plane, verdict
    assert len(views) == 8 + sum(len(page.panels()) for page in pages)
    assert empty_views(path) == []
    names = {view.origin: view.name for view in views}
    assert names["/traces/velocity"] == "Velocity [rad/s], red: limits"
    assert names["/traces/error"] == "Tracking error [mrad], limits −1000 to 1000"


def test_the_check_for_empty_views_finds_one(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    flat = Curve("nothing", "#ffffff", np.arange(3.0), np.full(3, np.nan))
    page = Page("fit", "Fit", ((TimePlot("Empty plot", (flat,)), Words("Said", "yes")),), (1.0,))
    write_rrd(path, recording(), Shown(pages=[page]))
    assert empty_views(path) == ["Empty plot"]


def test_what_has_no_data_is_left_out_of_a_page(sampled: Sampled) -> None:
    nothing = replace(sampled.comparison, modelled=np.full(len(sampled.comparison.time), np.nan))
    nothing = replace(nothing, measured=nothing.modelled)
    page = stage_pages.fit_page(nothing, None, "")
    assert not page.filled
    page = stage_pages.diagnosis_page((), sampled.steps[:1], (), "none", "N m")
    assert [type(panel) for _, panel in page.panels()] == [Words]
    assert not stage_pages.adaptation_page(()).filled


def test_a_recording_without_reference_velocity_or_rows_has_no_empty_view(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    time = np.arange(100) * 1e-3
    bare = Recording.from_columns(
        {"time": time, "position": time, "torque": time}, Metadata(sample_period=1e-3), "a"
    )
    write_rrd(path, bare)
    assert empty_views(path) == []
    write_rrd(path, recording(0), Shown(verdict="stopped"))
    assert empty_views(path) == []


def test_pages_survive_the_way_to_the_streamer(sampled: Sampled) -> None:
    for page in every_page(sampled):
        again = page_from_json(json.loads(json.dumps(page_to_json(page))))
        assert page_to_json(again) == page_to_json(page)
        assert [type(panel) for _, panel in again.panels()] == [type(panel) for _, panel in page.panels()]


def test_the_residual_is_shown_by_direction() -> None:
    """Pooled, what changes its sign with the direction averages to nothing (a friction level that is wrong)."""
    travel = np.tile(np.linspace(0.0, 1.0, 400), 2)
    way = np.repeat([1.0, -1.0], 400)
    chart = stage_pages.over(Residual("travel_since_reversal", "rad", travel, 0.04 * way), way)
    assert chart is not None
    means = {curve.name: curve.y.mean() for curve in chart.curves}
    assert means["forward"] == pytest.approx(40.0)  # mN m
    assert means["backward"] == pytest.approx(-40.0)
    assert "mN m" in chart.y_name


def test_the_band_of_a_parameter_is_its_spread_over_a_period(sampled: Sampled) -> None:
    time = np.arange(1000) * 0.01
    value = np.where(time < 5.0, 1.0 + 0.1 * np.sin(2 * np.pi * time), 1.0)
    trace = replace(sampled.traces[0], time=time, value=value)
    spread = stage_pages.convergence(trace, 1.0).curves[0].spread
    assert spread is not None
    assert spread[400] == pytest.approx(0.1 / np.sqrt(2), rel=0.02)  # of a sine of amplitude 0.1
    assert spread[-1] < 1e-6


def test_best_candidates_come_first_and_few_are_shown(sampled: Sampled) -> None:
    bars = stage_pages.ranking([*sampled.ranks] * 4)
    assert isinstance(bars, Bars)
    assert len(bars.bars) == stage_pages.MOST_RANKS
    assert [bar.value for bar in bars.bars] == sorted((bar.value for bar in bars.bars), reverse=True)


def test_curves_break_where_time_has_a_gap(sampled: Sampled) -> None:
    time = np.concatenate([np.arange(100), np.arange(5000, 5100)]) * 1e-3
    page = stage_pages.fit_page(
        replace(sampled.comparison, time=time, measured=np.ones(200), modelled=np.ones(200)), None, ""
    )
    plot = page.columns[0][0]
    assert isinstance(plot, TimePlot)
    assert np.isnan(plot.curves[0].y).sum() == 1


def test_charts_hold_their_curves() -> None:
    from autotune.view.page_plots import plane_of

    curve = Curve("c", "#ffffff", np.array([0.2, 3.7]), np.array([-0.011, 0.03]), np.array([0.001, 0.002]))
    plane = plane_of(Chart("t", "x", "y", (curve,)))
    assert plane.x_range[0] <= 0.2
    assert plane.x_range[1] >= 3.7
    assert plane.y_range[0] <= -0.012
    assert plane.y_range[1] >= 0.032
