"""What `autotune link` has measured, in words for the person at the machine."""

from __future__ import annotations

from autotune.tuning.link_check import LinkReport

HEAVY = 0.6  # share of the bus from which on nobody else should be on it


def recommendation(report: LinkReport) -> tuple[str, ...]:
    """Sentences: the cycle that this host holds, bus, torque semantics, recorder, priority."""
    words = (_about_cycle(report), *_about_bus(report), _about_torque(report), _about_recorder(report))
    priority = _about_priority(report)
    return (*words, priority) if priority else words


def _about_cycle(report: LinkReport) -> str:
    figures, asked = report.figures, 1e3 * report.cycle
    if figures.lock_step:
        return (
            f"The drive's time advances with the host's: {1e3 * figures.interval.median:.2f} ms a cycle here, and "
            "nothing can be late. A real drive will not wait."
        )
    late = 100.0 * figures.late_share
    if report.recommended_cycle == report.cycle:
        return f"This host holds the cycle of {asked:g} ms: {late:.2f} % late or lost."
    if report.recommended_cycle is None:
        return (
            f"This host does not hold {asked:g} ms ({late:.1f} % late or lost), nor 4 ms: free it of other work, "
            "use real-time priority, or let the drive record."
        )
    better = 1e3 * report.recommended_cycle
    return (
        f"This host does not hold {asked:g} ms ({late:.1f} % late or lost); set cycle = {better * 1e-3:g} in the "
        f"axis file ({better:g} ms)."
    )


def _about_bus(report: LinkReport) -> list[str]:
    if report.bus_load is None:
        return []
    share = f"{100 * report.bus_load:.0f} % of the bus at worst"
    if report.bus_load >= 1.0:
        return [f"Its frames take {share}: they do not fit; a longer cycle or a higher bit rate is needed."]
    if report.bus_load > HEAVY:
        return [f"Its frames take {share}: leave the bus to this axis, or take a longer cycle."]
    return [f"Its frames take {share}."]


def _about_torque(report: LinkReport) -> str:
    includes = report.torque["includes_feedforward"]
    if includes is None:
        return f"What the torque demand means cannot be told: {report.torque['reason']}."
    how = "includes" if includes else "does not include"
    return f"The torque demand {how} the torque offset; its sign is right, its scale {report.torque['scale']:.2f}."


def _about_recorder(report: LinkReport) -> str:
    seconds = report.recorder_seconds
    if not seconds:
        return "There is no recorder in the drive that could be used: samples come over the link."
    if report.fit and not report.figures.lost:
        return f"The drive's own recorder ({seconds:.0f} s) is used by 'autotune record'; this host would do without."
    return f"Use the drive's own recorder ({seconds:.0f} s): 'autotune record' does, and loses nothing."


def _about_priority(report: LinkReport) -> str:
    if report.priority.startswith("normal priority"):
        need = "is needed" if not report.fit else "would make it safer"
        return f"Real-time priority {need}: {report.priority}."
    return ""


def lines(report: LinkReport) -> list[str]:
    """The report as text."""
    f, trip = report.figures, report.round_trip
    what = "exchange" if f.lock_step else "jitter"
    return [
        f"axis {report.axis} at {report.link}",
        f"round trip    {_ms(trip.median)} median, {_ms(trip.p99)} at 99 %, {_ms(trip.largest)} at most",
        f"{what:13} {_ms(f.jitter.median)} median, {_ms(f.jitter.p99)} at 99 %, {_ms(f.jitter.largest)} at most",
        f"cycles        {f.cycles} of {_ms(report.cycle)}, {f.late} late, {f.lost} lost",
        f"priority      {report.priority}",
        *report.recommendation,
    ]


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.2f} ms"
