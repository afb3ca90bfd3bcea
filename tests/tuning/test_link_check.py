"""`autotune link`: figures from the times of answers, words from the figures, and the whole on the simulated axis."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.tuning.link_check import CycleFigures, LinkReport, Spread, figures_of, recommended_cycle
from autotune.tuning.link_probe import Timing
from autotune.tuning.link_words import lines, recommendation
from autotune_drivers.canopen.bus_load import bus_load, cycle_frames, frame_bits
from autotune_drivers.profile import read_profile
from tests.support.commands import called

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"
QUIET = Spread(1e-3, 2e-3, 3e-3)
KNOWN = {"meaning": "included", "includes_feedforward": True, "scale": 1.0, "reason": "as it should be"}


def answers(intervals: Floats, lost: int = 0) -> Timing:
    missed = np.zeros(len(intervals) + 1)
    missed[1] = lost
    return Timing(np.concatenate([[0.0], np.cumsum(intervals)]), missed)


def noisy(sigma: float, period: float = 1e-3, count: int = 4000) -> Floats:
    return np.abs(np.random.default_rng(1).normal(period, sigma, count))


def report(figures: CycleFigures, **changes: object) -> LinkReport:
    best = recommended_cycle(figures, 1e-3)
    content = {
        "axis": "x", "link": "canopen+slcan:x", "cycle": 1e-3, "round_trip": QUIET, "figures": figures,
        "bus_load": 0.42, "torque": KNOWN, "recorder_seconds": 0.0, "priority": "real-time priority 20",
        "recommended_cycle": best, "fit": best == 1e-3,
    } | changes  # fmt: skip
    made = LinkReport(**content)  # type: ignore[arg-type]
    return LinkReport(**(content | {"recommendation": recommendation(made)}))  # type: ignore[arg-type]


def test_a_quiet_host_holds_its_cycle() -> None:
    figures = figures_of(answers(noisy(3e-5)), 1e-3)
    assert not figures.lock_step
    assert figures.late == figures.lost == 0
    assert figures.jitter.p99 == pytest.approx(2.58 * 3e-5, rel=0.15)  # of a normal distribution, both sides
    assert "holds the cycle of 1 ms" in report(figures).recommendation[0]


@pytest.mark.parametrize(("sigma", "cycle"), [(4e-4, 4e-3), (2.5e-4, 2e-3), (2e-3, None)])
def test_a_loaded_host_is_told_which_cycle_it_holds(sigma: float, cycle: float | None) -> None:
    figures = figures_of(answers(noisy(sigma), lost=20), 1e-3)
    assert figures.late_share > 1e-3
    assert recommended_cycle(figures, 1e-3) == cycle
    said = report(figures, recorder_seconds=65.5, fit=False)
    assert ("set cycle" in said.recommendation[0]) == (cycle is not None)
    assert any("Use the drive's own recorder" in sentence for sentence in said.recommendation)


def test_lock_step_is_recognised_and_nothing_is_late_in_it() -> None:
    figures = figures_of(answers(noisy(2e-5, 2e-4)), 1e-3)
    assert figures.lock_step
    assert figures.late == 0
    assert "advances with the host's" in report(figures).recommendation[0]


def test_words_for_bus_torque_and_priority() -> None:
    figures = figures_of(answers(noisy(3e-5)), 1e-3)
    unknown = {
        "meaning": "unknown",
        "includes_feedforward": None,
        "scale": None,
        "reason": "the sign is wrong",
    }
    said = " ".join(
        report(figures, bus_load=1.2, torque=unknown, priority="normal priority (no)").recommendation
    )
    for part in ("do not fit", "the sign is wrong", "Real-time priority"):
        assert part in said
    assert "leave the bus" in " ".join(report(figures, bus_load=0.7).recommendation)
    assert any("60" in line or "round trip" in line for line in lines(report(figures)))


def test_bus_load_of_known_frames() -> None:
    """CiA: a frame of 8 bytes has 111 to 135 bits; four of them and SYNC a millisecond are about half of 1 Mbit/s."""
    assert frame_bits(8) == 135
    assert frame_bits(0) == 55
    profile = read_profile("autotune-sim")
    frames = cycle_frames(profile)
    assert frames[0] == 0
    assert sum(frames) == 2 + 4 + 2 + 2 + 4 + 2 + 4 * 4
    assert bus_load(profile, 1e-3, 1e6) == pytest.approx(sum(map(frame_bits, frames)) / 1000)
    assert bus_load(profile, 2e-3, 1e6) == pytest.approx(0.5 * bus_load(profile, 1e-3, 1e6))


def test_the_command_on_the_simulated_axis(tmp_path: Path) -> None:
    axis = tmp_path / "axis.toml"
    text = EXAMPLE.read_text()
    link = 'link = "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5"'
    assert link in text
    axis.write_text(text.replace(link, 'link = "sim://edm-vertical"'))
    done = called("link", str(axis), "--json", "--runs", str(tmp_path / "runs"))
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["figures"]["cycles"] == 4000
    assert said["figures"]["lost"] == 0
    assert said["torque"]["includes_feedforward"] is True
    assert said["torque"]["scale"] == pytest.approx(1.0, abs=0.2)
    assert said["bus_load"] is None
    assert len(said["recommendation"]) >= 3
