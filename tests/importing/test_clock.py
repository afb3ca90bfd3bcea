"""Time stamps and positions as others record them: jitter, gaps, restarts, overflow, wrap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from autotune.core.errors import ConfigurationError, RecordingError
from autotune.recordings.importing.cleaning import unwrap_clock, without_copies
from autotune.recordings.importing.clock import RegularPiece
from autotune.recordings.importing.pieces import without_held

from .conftest import Floats, axis_signals, bring_in, write_table


def sampled_at(time: Floats) -> dict[str, Floats]:
    """The made-up axis at any moments."""
    omega = 2.0 * np.pi * 1.5
    position, velocity = 0.8 * np.sin(omega * time), 0.8 * omega * np.cos(omega * time)
    torque = -0.01 * omega**2 * position + 0.3 * np.tanh(velocity / 0.05) + 0.05 * velocity + 0.1
    return {"time": time, "position": position, "velocity": velocity, "torque": torque}


def test_jitter_is_resampled_onto_the_true_motion(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    time = 1e-3 * np.arange(3000) + random.uniform(-3e-4, 3e-4, 3000)
    imported = bring_in(write_table(tmp_path / "t.csv", sampled_at(time), digits=12))
    recording = imported.recording
    np.testing.assert_allclose(np.diff(recording["time"]), recording.period, rtol=1e-6)
    true = sampled_at(recording["time"])
    assert recording.period == 1e-3
    # third-order pieces: about omega³ h³/30 of 0.8 rad with h up to 1.6 ms; torque is linear, so
    # where friction turns round within 1.4 ms an eighth of its second difference is lost
    np.testing.assert_allclose(recording["position"], true["position"], atol=4e-7)
    np.testing.assert_allclose(recording["torque"], true["torque"], atol=0.08)
    assert np.sqrt(np.mean((recording["torque"] - true["torque"]) ** 2)) < 4e-3
    assert "cubic for position" in recording.metadata.extra["resampled"]
    assert any("irregular" in line for line in imported.lines)


def test_small_holes_are_filled_and_gaps_split(tmp_path: Path, signals: dict[str, Floats]) -> None:
    keep = np.ones(2000, dtype=bool)
    keep[[100, 500, 501, 502]] = False
    keep[1000:1050] = False
    path = write_table(tmp_path / "drop.csv", {name: values[keep] for name, values in signals.items()})
    recording = bring_in(path).recording
    segments = recording.segments()
    assert [(s.experiment, s.start, s.stop) for s in segments] == [("drop", 0, 1000), ("drop-2", 1000, 1950)]
    assert recording.missed[1000] == 50
    assert recording.missed.sum() == 50
    true = sampled_at(recording["time"])
    # three lost samples: about omega³ h³/30 of 0.8 rad with h = 4 ms
    np.testing.assert_allclose(recording["position"], true["position"], atol=4e-6)


def test_samples_that_a_slower_file_lost_are_counted_in_the_period_of_all(tmp_path: Path) -> None:
    """Fifty of 2 ms, beside a file of 1 ms: those are 101 samples between the rows on either side."""
    slow, keep = axis_signals(2000, 2e-3), np.ones(2000, dtype=bool)
    keep[1000:1050] = False
    paths = [
        write_table(tmp_path / "quick.csv", axis_signals()),
        write_table(tmp_path / "slow.csv", {name: values[keep] for name, values in slow.items()}),
    ]
    recording = bring_in(*paths).recording
    (after,) = np.flatnonzero(recording.missed)
    assert recording.missed[after] == 101
    apart = recording["time"][after] - recording["time"][after - 1]
    assert apart == pytest.approx((recording.missed[after] + 1) * recording.period)


def test_rounded_stamps_are_straightened(tmp_path: Path) -> None:
    time = 1.6e-3 * np.arange(2000)
    columns = sampled_at(time)
    columns["time"] = np.round(time, 3)
    recording = bring_in(write_table(tmp_path / "t.csv", columns)).recording
    assert recording.period == pytest.approx(1.6e-3, rel=1e-4)
    # within half of the last digit written
    np.testing.assert_allclose(recording["time"], time, atol=5.1e-4)
    np.testing.assert_allclose(recording["position"], columns["position"], rtol=1e-8, atol=1e-12)


def test_single_precision_stamps_are_regular(tmp_path: Path) -> None:
    columns = axis_signals(4000)
    columns["time"] = (columns["time"] + 500).astype(np.float32).astype(float)
    recording = bring_in(write_table(tmp_path / "t.csv", columns)).recording
    assert recording.period == pytest.approx(1e-3, rel=1e-4)
    np.testing.assert_allclose(recording["torque"], columns["torque"], rtol=1e-8)


def test_a_clock_that_starts_again_begins_a_segment(tmp_path: Path, signals: dict[str, Floats]) -> None:
    twice = {name: np.concatenate([values, values[:1500]]) for name, values in signals.items()}
    recording = bring_in(write_table(tmp_path / "two.csv", twice)).recording
    assert [(s.experiment, s.repeat, s.stop) for s in recording.segments()] == [
        ("two", 0, 2000),
        ("two-2", 0, 3500),
    ]


def test_runs_with_the_same_reference_are_repetitions(tmp_path: Path, signals: dict[str, Floats]) -> None:
    signals["reference"] = signals["position"] * 1.01
    thrice = {name: np.tile(values, 3) for name, values in signals.items()}
    recording = bring_in(write_table(tmp_path / "r.csv", thrice)).recording
    assert [(s.experiment, s.repeat) for s in recording.segments()] == [("r", 0), ("r", 1), ("r", 2)]


@pytest.mark.parametrize("period", [None, 0.001], ids=["stamps", "--period"])
def test_a_column_of_repetitions_cuts(
    tmp_path: Path, signals: dict[str, Floats], period: float | None
) -> None:
    signals["cycle"] = np.repeat([1.0, 2.0], 1000)
    table = write_table(tmp_path / "c.csv", signals)
    recording = bring_in(table, columns=("repeat=cycle",), period=period).recording
    assert [(s.experiment, s.repeat, s.stop) for s in recording.segments()] == [
        ("c", 1, 1000),
        ("c", 2, 2000),
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.__setitem__(700, t[699]), "duplicated at row 701: 0.699 s"),
        (lambda t: t.__setitem__(700, 0.5), "decreases at row 701: 0.5 s after 0.699 s"),
        (lambda t: t.__setitem__(slice(None), t[::-1].copy()), "never increases|decreases at row 2"),
        (lambda t: t.__setitem__(slice(None), np.round(t, 2)), "too few digits"),
        (lambda t: t.__setitem__(slice(None), 3.0), "never increases"),
    ],
)
def test_time_that_cannot_be_is_refused_with_its_row(
    tmp_path: Path, signals: dict[str, Floats], change: object, message: str
) -> None:
    change(signals["time"])  # type: ignore[operator]
    with pytest.raises(RecordingError, match=message):
        bring_in(write_table(tmp_path / "t.csv", signals))


def test_the_period_replaces_stamps_that_only_jitter(tmp_path: Path, signals: dict[str, Floats]) -> None:
    columns = dict(signals)
    columns["time"] = np.round(signals["time"], 2)
    recording = bring_in(write_table(tmp_path / "t.csv", columns), period=1e-3).recording
    np.testing.assert_allclose(recording["time"], signals["time"], atol=1e-9)
    columns.pop("time")
    recording = bring_in(write_table(tmp_path / "t.csv", columns), period=1e-3).recording
    np.testing.assert_allclose(recording["time"], signals["time"], atol=1e-9)
    with pytest.raises(RecordingError, match="rows are missing, or the period is another"):
        bring_in(write_table(tmp_path / "t.csv", signals), period=2e-3)


def test_a_clock_counter_that_overflows_goes_on(tmp_path: Path, signals: dict[str, Floats]) -> None:
    ticks = (np.arange(2000) * 1000 + 2**32 - 900_500) % 2**32
    columns = {**signals, "time": ticks.astype(float)}
    path = write_table(tmp_path / "t.csv", columns, head="t [us],pos [rad],vel [rad/s],tau [Nm]", digits=12)
    recording = bring_in(path).recording
    assert len(recording.segments()) == 1
    assert recording.period == pytest.approx(1e-3)


@pytest.mark.parametrize("with_reference", [False, True])
def test_a_position_that_wraps_after_a_turn_is_unwrapped(tmp_path: Path, with_reference: bool) -> None:
    time = 1e-3 * np.arange(4000)
    position = 3.0 + 9.0 * np.sin(2 * time)
    velocity = 18.0 * np.cos(2 * time)
    torque = 0.3 * np.sign(velocity) - 0.01 * 36 * np.sin(2 * time)
    columns = {"time": time, "position": position % (2 * np.pi), "torque": torque}
    if with_reference:
        columns["reference"] = (position + 0.01) % (2 * np.pi)
    imported = bring_in(write_table(tmp_path / "t.csv", columns))
    np.testing.assert_allclose(imported.recording["position"], position, atol=1e-7)
    if with_reference:
        np.testing.assert_allclose(imported.recording["reference"], position + 0.01, atol=1e-7)
    assert any("starts again after 6.28319 rad: unwrapped" in line for line in imported.lines)


def test_an_encoder_register_that_overflows_is_unwrapped(tmp_path: Path) -> None:
    time = 1e-3 * np.arange(4000)
    counts = np.round(30000 + 20000 * np.sin(2 * time))
    wrapped = (counts + 2**15) % 2**16 - 2**15
    torque = 0.3 * np.sign(np.cos(2 * time))
    path = write_table(tmp_path / "t.csv", {"time": time, "pos": wrapped, "torque": torque})
    recording = bring_in(path, columns=("position=pos*2*pi/65536",)).recording
    np.testing.assert_allclose(
        recording["position"] - recording["position"][0], (counts - counts[0]) * 2 * np.pi / 65536, atol=1e-6
    )


def test_position_from_velocity(tmp_path: Path, signals: dict[str, Floats]) -> None:
    true = signals.pop("position")
    imported = bring_in(write_table(tmp_path / "t.csv", signals))
    # trapezoids of 1 ms on a sine of 1.5 Hz: h² ω²/12 of 0.8 rad
    np.testing.assert_allclose(imported.recording["position"], true - true[0], atol=1e-5)
    assert "integrated" in imported.recording.metadata.extra["position"]


def test_several_files_are_segments_named_after_them(tmp_path: Path, signals: dict[str, Floats]) -> None:
    slow = {name: values[::4] for name, values in signals.items()}
    files = [
        write_table(tmp_path / "a b.csv", signals),
        write_table(tmp_path / "slow.csv", slow),
        write_table(tmp_path / "test.csv", signals),
    ]
    imported = bring_in(*files)
    names = [(s.experiment, s.repeat, s.stop - s.start) for s in imported.recording.segments()]
    assert names == [("a_b", 0, 2000), ("slow", 0, 1997), ("file-test", 0, 2000)]
    assert any("interpolated to 0.001 s" in line for line in imported.lines)
    np.testing.assert_allclose(
        imported.recording.select("slow")["position"], signals["position"][:1997], atol=1e-4
    )
    same = bring_in(files[0], files[2], experiment="sine").recording
    assert [(s.experiment, s.repeat) for s in same.segments()] == [("sine", 0), ("sine", 1)]


def test_an_unknown_format_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="known are csv, mat, epos, parquet"):
        bring_in(tmp_path / "x", kind="xlsx")


def test_of_stamps_that_jitter_the_motion_tells_whether_the_samples_do(tmp_path: Path) -> None:
    """20 µs on the stamps of a regular drive were as much position noise as the motion covers in them."""
    regular = 1e-3 * np.arange(3000)
    stamps = regular + np.random.default_rng(2).normal(0.0, 1e-4, 3000)
    columns = sampled_at(regular)
    imported = bring_in(write_table(tmp_path / "t.csv", columns | {"time": stamps}, digits=12))
    np.testing.assert_allclose(imported.recording["position"], columns["position"], rtol=1e-9, atol=1e-12)
    assert any("rows are counted" in line for line in imported.lines)
    really = bring_in(write_table(tmp_path / "r.csv", sampled_at(stamps), digits=12))
    assert any("irregular" in line for line in really.lines)


def test_rows_written_twice_are_dropped_and_others_of_one_time_refused(tmp_path: Path) -> None:
    rows = np.sort(np.r_[np.arange(2000), [300, 700, 701]])
    columns = {name: values[rows] for name, values in sampled_at(1e-3 * np.arange(2000)).items()}
    imported = bring_in(write_table(tmp_path / "t.csv", columns))
    assert len(imported.recording) == 2000
    assert any("3 rows repeat the row before" in line for line in imported.lines)
    columns["torque"][301] += 1.0
    with pytest.raises(RecordingError, match="duplicated at row 302"):
        bring_in(write_table(tmp_path / "t.csv", columns))


def test_a_file_written_faster_than_it_was_read_is_thinned(tmp_path: Path) -> None:
    """Steps of five rows were motion in jerks; a column that changes at every row says that it was read then."""
    time = 1e-3 * np.arange(3000)
    held = {name: np.repeat(values[::5], 5) for name, values in sampled_at(time).items()} | {"time": time}
    imported = bring_in(write_table(tmp_path / "t.csv", held))
    assert imported.recording.period == pytest.approx(5e-3)
    assert any("every 5th row only" in line for line in imported.lines)
    np.testing.assert_allclose(
        imported.recording["position"], sampled_at(imported.recording["time"])["position"], atol=1e-6
    )
    mixed = held | {"torque": sampled_at(time)["torque"]}
    assert bring_in(write_table(tmp_path / "m.csv", mixed)).recording.period == pytest.approx(1e-3)


def test_stamps_that_jitter_back_are_said_and_counted_on_demand(tmp_path: Path) -> None:
    regular = 1e-3 * np.arange(3000)
    columns = sampled_at(regular)
    columns["time"] = regular + np.random.default_rng(3).normal(0.0, 3e-4, 3000)
    path = write_table(tmp_path / "t.csv", columns, digits=12)
    with pytest.raises(RecordingError, match=r"jitter by more .* --period 0.00"):
        bring_in(path)
    counted = bring_in(path, period=1e-3).recording
    np.testing.assert_allclose(counted["position"], columns["position"], rtol=1e-9, atol=1e-12)


def test_rows_that_are_counted_must_all_be_there(tmp_path: Path, signals: dict[str, Floats]) -> None:
    """Three rows that were dropped let all later ones come 3 ms too soon; without a clock they were counted before."""
    holed = {name: values.copy() for name, values in signals.items()}
    holed["torque"][700:703] = np.nan
    with pytest.raises(RecordingError, match="leave --period out"):
        bring_in(write_table(tmp_path / "t.csv", holed), period=1e-3)
    holed.pop("time")
    recording = bring_in(write_table(tmp_path / "t.csv", holed), period=1e-3).recording
    there = np.rint(recording["time"] / 1e-3).astype(int)
    np.testing.assert_allclose(recording["position"], signals["position"][there], atol=1e-6)


def test_a_column_without_numbers_hides_neither_copies_nor_held_rows() -> None:
    empty = np.full(4000, np.nan)
    columns = {"time": 1e-3 * np.arange(4000), "position": np.repeat(np.sin(0.01 * np.arange(1000)), 4)}
    (held,), period = without_held([RegularPiece({**columns, "temperature": empty})], 1e-3, [], {})
    assert (len(held), period) == (1000, 4e-3)
    twice = {name: values[[0, 4, 4, 8]] for name, values in {**columns, "temperature": empty}.items()}
    assert len(without_copies(twice, [])["time"]) == 3


def test_a_clock_with_a_hole_goes_on_after_it_overflows() -> None:
    counter = np.arange(100_000.0) % 65_536
    counter[5] = np.nan
    whole = unwrap_clock(counter, [])
    assert whole[-1] == 99_999.0
    assert np.isnan(whole[5])
