"""A profile against a drive's data sheet: is every object there, of the right type, and accessible?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from autotune_drivers.canopen.data_sheet import DataSheet
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.profile import Profile

FINE = "there"


@dataclass(frozen=True, slots=True)
class Use:
    """What a profile wants of an object. `access`: letters r and w; `optional`: skipped where it lacks."""

    what: str
    ref: ObjectRef
    access: str
    mapped: bool = False
    optional: bool = False
    typed: bool = True


@dataclass(frozen=True, slots=True)
class Checked:
    """One line of the table; `verdict` is `FINE`, or what is wrong in words."""

    use: Use
    name: str
    verdict: str

    @property
    def fine(self) -> bool:
        return self.verdict == FINE


def uses(profile: Profile) -> Iterator[Use]:
    """Every object of a profile, with what is done with it."""
    yield Use("torque.rated", profile.torque.rated.ref, "r")
    if profile.torque.constant is not None:
        yield Use("torque.constant", profile.torque.constant.ref, "r")
    for name, signal in profile.signals:
        if signal is not None:
            yield Use(f"signals.{name}", signal.ref, "r", mapped=True)
    for name, signal in profile.commands:
        yield Use(f"commands.{name}", signal.ref, "w", mapped=True)
    for name, parameter in profile.parameters.items():
        yield Use(name, parameter.at.ref, "rw")
    for text in profile.expects:
        yield Use("expects", ObjectRef.parse(text), "r")
    for text in profile.session:
        yield Use("session", ObjectRef.parse(text), "rw", optional=True)
    yield from _others(profile)
    yield from _recorder(profile)


def _others(profile: Profile) -> Iterator[Use]:
    if profile.quick_stop_deceleration is not None:
        yield Use("quick_stop_deceleration", profile.quick_stop_deceleration.ref, "rw", optional=True)
    if profile.clock is not None:
        yield Use("clock", profile.clock.at, "r")
    if profile.guard.watchdog is not None:
        yield Use("guard.watchdog", profile.guard.watchdog.ref, "rw")
    if profile.store is not None:
        yield Use("store", profile.store.at, "w")
    if profile.friction_table is not None:
        for name, signal in profile.friction_table.places().items():
            yield Use(name, signal.ref, "rw")
    if profile.ripple is not None:
        for name, (ref, _) in profile.ripple.places().items():
            yield Use(name, ref, "rw")
        for name, ref in profile.ripple.told().items():
            yield Use(name, ref, "r")
        if profile.ripple.save is not None:
            yield Use("ripple.save", profile.ripple.save.command, "w", typed=False)
            yield Use("ripple.save", profile.ripple.save.status, "r")


def _recorder(profile: Profile) -> Iterator[Use]:
    recorder = profile.recorder
    if recorder is None:
        return
    yield Use("recorder.control", recorder.control, "w")
    yield Use("recorder.wanted", recorder.wanted, "rw")
    yield Use("recorder.recorded", recorder.recorded, "r")
    if recorder.period is not None:
        yield Use("recorder.period", recorder.period.ref, "rw")
    for text in recorder.setup:
        yield Use("recorder.setup", ObjectRef.parse(text), "rw")
    for ref in recorder.channels:
        yield Use("recorder.channels", ref, "rw")
    for ref in recorder.data:
        yield Use("recorder.data", ref, "r", typed=False)
    for name, signal in recorder.columns.items():
        yield Use(f"recorder.columns.{name}", signal.ref, "r", mapped=True)


def check(profile: Profile, sheet: DataSheet) -> list[Checked]:
    """Compares; what is optional and not there is left out."""
    lines = []
    for use in uses(profile):
        found = sheet.objects.get((use.ref.index, use.ref.sub))
        if found is None:
            if not use.optional:
                lines.append(Checked(use, "", "not there"))
            continue
        wrong = []
        if use.typed and found.type != use.ref.type:
            wrong.append(f"is {found.type}, not {use.ref.type}")
        if "r" in use.access and not found.readable:
            wrong.append("cannot be read")
        if "w" in use.access and not found.writable:
            wrong.append("cannot be written")
        if use.mapped and not found.mappable:
            wrong.append("cannot be mapped to a PDO")
        lines.append(Checked(use, found.name, "; ".join(wrong) or FINE))
    return lines


def table(title: str, lines: list[Checked]) -> str:
    """The comparison as text, for people."""
    rows = [
        f"  {line.use.ref.index:04X}:{line.use.ref.sub:02X}  "
        f"{line.use.ref.type:4} {line.use.what:32} {line.name[:40]:40} {line.verdict}"
        for line in lines
    ]
    good = sum(line.fine for line in lines)
    return "\n".join([f"{title}: {good} of {len(lines)} objects as the profile has them", *rows])
