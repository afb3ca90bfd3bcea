"""Is this host and link fit for the cycle asked for: measured at rest, judged, and said in words."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.axis import Axis
from autotune.core.drive_recording import RecordingLoop
from autotune.core.errors import AutotuneError, GuardStop, LinkError
from autotune.core.loop import Loop
from autotune.experiments.torque_semantics import Meaning, TorqueSemantics
from autotune.tuning.link_probe import LinkProbe, Timing
from autotune.tuning.preparation import SessionRequest, connected, own_run, prepared
from autotune.tuning.recovery import recover
from autotune.tuning.session import Session
from autotune.tuning.torque_check import INCLUDES, contradiction, must_be_found, torque_semantics
from autotune.view.pages import Page
from autotune.view.stage_pages import link_page

PROBE_SECONDS = 4.0
ROUND_TRIPS = 60
LATE = 1.5  # periods between two answers from which on a cycle counts as late
LOCK_STEP = 0.7
CYCLES = (0.001, 0.002, 0.004)
MOST_LATE = 1e-3
MARGIN = 1.25


@dataclass(frozen=True, slots=True)
class Spread:
    """Of times [s]."""

    median: float
    p99: float
    largest: float

    @classmethod
    def of(cls, values: Floats) -> Spread:
        if not len(values):
            return cls(float("nan"), float("nan"), float("nan"))
        return cls(float(np.median(values)), float(np.quantile(values, 0.99)), float(values.max()))


@dataclass(frozen=True, slots=True)
class CycleFigures:
    """Of the cycles played: `jitter` is |time between answers − period|; in lock-step the whole exchange."""

    cycles: int
    lost: int
    late: int
    jitter: Spread
    interval: Spread
    lock_step: bool

    @property
    def late_share(self) -> float:
        return (self.late + self.lost) / max(self.cycles + self.lost, 1)


@dataclass(frozen=True)
class LinkReport:
    """What `autotune link` says.

    Attributes:
        round_trip: of one parameter read, to the drive and back.
        bus_load: share of the bus that the cycles take; None where the link is no bus.
        recommended_cycle: s; None where none of the usual ones can be held.
        torque: meaning of the torque demand, in the drive's own terms; "unknown" with a reason.
        recorder_seconds: what the drive's own recorder holds; 0 where there is none.
        recommendation: sentences.
    """

    axis: str
    link: str
    cycle: float
    round_trip: Spread
    figures: CycleFigures
    bus_load: float | None
    torque: dict[str, Any]
    recorder_seconds: float
    priority: str
    recommended_cycle: float | None
    fit: bool
    recommendation: tuple[str, ...] = field(default=())

    def as_json(self) -> dict[str, Any]:
        """The object of `link --json`."""
        content = asdict(self)
        content["figures"]["late_share"] = self.figures.late_share
        content["recommendation"] = list(self.recommendation)
        return content


def check_link(request: SessionRequest, load: float | None, remarks: Sequence[str] = ()) -> LinkReport:
    """Measures the link of an axis, which holds still under power meanwhile.

    Args:
        request: of the axis.
        load: share of the bus that its cycles take, or None.
        remarks: what the profile says to the person who commissions the axis.

    Raises:
        AutotuneError: nobody there, or the drive cannot be powered; everything is put back.
    """
    with (
        own_run(request) as run,
        connected(run.opening, run.journal, request.reporter) as loop,
    ):
        for sentence in recover(loop, request.runs, run.journal):
            request.reporter.say(sentence)
        with prepared(request, loop, run.journal) as session:
            return _measured(session, loop, load, remarks)


def _measured(session: Session, loop: Loop, load: float | None, remarks: Sequence[str]) -> LinkReport:
    axis = session.axis
    session.begin("link", PROBE_SECONDS + 3.0)
    priority = str(getattr(loop, "priority", "in this process"))
    trips = _round_trips(loop)
    probe = LinkProbe(session.limits, round(PROBE_SECONDS / axis.cycle), axis.position_resolution)
    timing = loop.play(probe, session.watching(probe.labels))
    figures = figures_of(timing, axis.cycle)
    session.show(lambda: _shown(timing, axis.cycle, trips, figures))
    torque = _torque(session)
    recorder = loop.recorder_seconds() if isinstance(loop, RecordingLoop) else 0.0
    best = recommended_cycle(figures, axis.cycle)
    fit = (
        _fits(figures, axis.cycle)
        and (load is None or load < 1.0)
        and torque["meaning"] != Meaning.UNKNOWN.value
    )
    report = LinkReport(
        axis.name, axis.link, axis.cycle, trips, figures, load, torque, recorder, priority, best, fit
    )
    return _with_words(report, remarks)


def _shown(timing: Timing, period: float, trips: Spread, figures: CycleFigures) -> Page:
    """The cycles as they came, for the viewer."""
    spreads = [("round trip", trips), ("exchange" if figures.lock_step else "jitter", figures.jitter)]
    bars = [
        (f"{name}, {words}", value)
        for name, spread in spreads
        for words, value in (("median", spread.median), ("99 %", spread.p99), ("largest", spread.largest))
    ]
    times = timing.answered[1:] - timing.answered[0]
    words = f"{figures.cycles} cycles, {figures.lost} lost, {figures.late} late"
    return link_page(times, np.diff(timing.answered), period, bars, words)


def _round_trips(loop: Loop) -> Spread:
    """Times of single parameter reads."""
    names = list(loop.read_parameters())
    one = [name for name in names if name != INCLUDES][:1]
    times = np.empty(ROUND_TRIPS)
    for k in range(ROUND_TRIPS):
        began = time.perf_counter()
        loop.read_parameters(one)
        times[k] = time.perf_counter() - began
    return Spread.of(times)


def figures_of(timing: Timing, period: float) -> CycleFigures:
    """Judges the times of answers.

    Answers that come much faster than the cycle are those of a drive whose time advances with the host's
    (lock-step): nothing is late there, and the interval is that of the exchange.
    """
    interval = np.diff(timing.answered)
    lock_step = float(np.median(interval)) < LOCK_STEP * period
    jitter = np.abs(interval - period)
    late = 0 if lock_step else int(np.count_nonzero(interval > LATE * period))
    lost = int(timing.missed.sum())
    return CycleFigures(
        len(timing.answered),
        lost,
        late,
        Spread.of(interval if lock_step else jitter),
        Spread.of(interval),
        lock_step,
    )


def _fits(figures: CycleFigures, period: float) -> bool:
    if figures.lock_step:
        return True
    return figures.late_share <= MOST_LATE and figures.jitter.p99 < 0.5 * period


def recommended_cycle(figures: CycleFigures, period: float) -> float | None:
    """The shortest usual cycle that this host holds with 99.9 % of its cycles in time, or None.

    In real time the 99 % quantile of the jitter has to leave half of the cycle; in lock-step the exchange
    itself has to fit.
    """
    if _fits(figures, period) and not figures.lock_step:
        return period
    needed = MARGIN * (figures.jitter.p99 if figures.lock_step else 2.0 * figures.jitter.p99)
    known = [cycle for cycle in CYCLES if cycle >= needed and (figures.lock_step or cycle > period)]
    return known[0] if known else None


def _torque(session: Session) -> dict[str, Any]:
    """The step at standstill; what cannot be told is no error here, but a finding."""
    try:
        found = torque_semantics(session)
    except (GuardStop, LinkError):
        raise
    except AutotuneError as error:
        return {
            "meaning": Meaning.UNKNOWN.value,
            "includes_feedforward": None,
            "scale": None,
            "reason": str(error),
        }
    return _told(session, found)


def _told(session: Session, found: TorqueSemantics) -> dict[str, Any]:
    includes: bool | None = None
    reason = found.reason
    if found.meaning is not Meaning.UNKNOWN:
        if must_be_found(session):
            assumed = bool(session.loop.read_parameters([INCLUDES])[INCLUDES])
            includes = assumed if found.meaning is Meaning.INCLUDED else not assumed
        elif found.meaning is Meaning.INCLUDED:
            includes = True
        else:
            reason = contradiction(found)
    meaning = found.meaning.value if includes is not None else Meaning.UNKNOWN.value
    return {
        "meaning": meaning,
        "includes_feedforward": includes,
        "scale": found.scale,
        "excess": found.excess,
        "error": found.error,
        "reason": reason,
    }


def _with_words(report: LinkReport, remarks: Sequence[str]) -> LinkReport:
    from autotune.tuning.link_words import recommendation

    return replace(report, recommendation=(*recommendation(report), *remarks))


def remarks_of(axis: Axis, directory: Path) -> tuple[float | None, tuple[str, ...]]:
    """Bus load and the profile's remarks; (None, ()) for links without a CAN profile."""
    if not axis.link.startswith("canopen+"):
        return None, ()
    from autotune_drivers.canopen.bus_load import bus_load
    from autotune_drivers.profile import read_profile
    from autotune_drivers.url import parse_link

    profile = read_profile(axis.profile, directory)
    bitrate = parse_link(axis.link, directory).options.get("bitrate", 1_000_000)
    return bus_load(profile, axis.cycle, bitrate), profile.remarks
