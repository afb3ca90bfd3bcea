"""Torque ripple into the drive: which waves it can hold, where its turn begins, and whether they act.

What a drive holds of ripple acts from its commutation encoder, whose zero nobody has told us. So the commit begins
with an experiment: sweeps of one turn, as the axis is, with two sets of trial waves, and with the result
(`control.ripple_alignment`). Trials are written to the drive's volatile memory only, one at a time, each noted in
the journal before and put back after. What moves the zero is read before and after, and kept with the backup.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from autotune.control.ripple_alignment import (
    Alignment,
    Lines,
    align,
    around,
    correction,
    held_against,
    lines_of,
    remaining,
    resolved,
    size_of,
)
from autotune.control.ripple_reduction import KeptRipple, LeftOut, RippleBlock, drive_values, keep
from autotune.core.errors import ConfigurationError, NotEnoughExcitation
from autotune.core.ripple_parameters import GAIN, alignment_of, is_ripple, moved
from autotune.experiments.ripple_sweep import BACKWARD, FORWARD, sweep_of
from autotune.models.drive_model import DriveModel
from autotune.models.waves import ripple_waves
from autotune.recordings.recording import Recording
from autotune.tuning.commit import write_verified
from autotune.tuning.session import Session
from autotune.tuning.stage_prove import GIVEN_BACK, committed_seconds

SWEEPS = 5  # as it is, two trials, the result, and after the commit
LEAST_KEPT = 0.1  # share of the ripple below which nothing is worth writing
TRIAL_SHARE = 0.05  # of the torque limit: largest sum of trial waves
RATIO = 2.0  # what is written may be so many times what the model says, or so little
ALIKE = 0.6  # least agreement of the model's waves with those that the axis asks for


@dataclass(frozen=True)
class RipplePlan:
    """Ripple that goes into the drive.

    Attributes:
        values: complete set of the drive's ripple parameters.
        kept: which waves of the model that is, and what is left out.
        alignment: what the trials said; `alignment.left` is predicted.
        settings: what moves the zero of the drive's angle, as it was then.
        rest: lines of the tracking error without it.
    """

    values: Mapping[str, float]
    kept: KeptRipple
    alignment: Alignment
    settings: Mapping[str, float]
    rest: Lines

    def in_words(self) -> str:
        """For a person, before it is written."""
        return f"the drive takes {self.kept.in_words()} (aligned by experiment)"


def plan_ripple(session: Session, model: DriveModel | None, held: Mapping[str, float]) -> RipplePlan | str:
    """What of the model's ripple this drive can hold, aligned by experiment; else why it holds none of it.

    "" where there is no ripple in the model, or the drive knows none.

    Raises:
        AutotuneError: the axis had to be stopped, or the drive could not be written; it is as it was then.
    """
    values = session.loop.read_parameters()
    block = RippleBlock.of(values)
    waves = list(ripple_waves(model)) if model is not None else []
    if block is None or not waves:
        return ""
    if session.motion.revolution is None:
        return "torque ripple stays with the host: the drive holds it over the turn of a motor, and this axis is linear"
    kept = keep(waves, block)
    if kept.kept < LEAST_KEPT:
        return f"torque ripple stays with the host: this drive, with {block.in_words}, would take {kept.in_words()}"
    try:
        return _aligned(
            session, kept, block, alignment_of(values), {n: v for n, v in held.items() if is_ripple(n)}
        )
    except (NotEnoughExcitation, ConfigurationError) as error:
        return f"torque ripple stays with the host: {error}"


def _aligned(
    session: Session,
    kept: KeptRipple,
    block: RippleBlock,
    settings: Mapping[str, float],
    held: Mapping[str, float],
) -> RipplePlan:
    every = around(kept.waves, block.highest_order)
    _must_fit(session, max(every))
    rest, noise = _lines(session, "rest", every)
    shown = resolved(kept.waves, rest)
    trial = _trial(session, shown)
    sides: list[Lines] = []
    for name, turn in (("trial-a", 1.0 + 0j), ("trial-b", 1j)):
        waves = {order: size * turn for order, size in trial.items()}
        with _written(session, drive_values(waves, 1, block), held):
            sides.append(_lines(session, name, every)[0])
    same = {order: wave for order, wave in kept.waves.items() if shown.get(order) == wave}
    found = held_against(align(rest, sides[0], sides[1], trial, noise), same)
    _must_agree(found)
    values = drive_values(found.waves, found.sense, block)
    with _written(session, values, held):
        left = _lines(session, "result", every)[0]
    found = _refined(found, rest, left)
    now = alignment_of(session.loop.read_parameters(list(settings)))
    if changed := moved(settings, now):
        raise ConfigurationError(
            f"the drive's commutation was changed meanwhile ({'; '.join(changed)}); run again"
        )
    kept = without_weak(kept, shown, found)
    return RipplePlan(drive_values(found.waves, found.sense, block), kept, found, settings, rest)


def without_weak(kept: KeptRipple, shown: Mapping[int, complex], found: Alignment) -> KeptRipple:
    """What is written in the end: waves that did not stand out are left out, in words."""
    out = [LeftOut(float(n), abs(shown[n]), "too small to stand out on this axis") for n in found.weak]
    total = sum(abs(wave) ** 2 for wave in shown.values())
    lost = math.hypot(1.0 - kept.kept, math.sqrt(sum(one.amplitude**2 for one in out) / total))
    return KeptRipple(found.waves, (*kept.left_out, *out), max(0.0, 1.0 - lost))


def _refined(found: Alignment, rest: Lines, left: Lines) -> Alignment:
    """With what was still there corrected; `left` is what that promises. Raises NotEnoughExcitation: nothing gained."""
    share = size_of(left) / size_of(rest)
    if share > 1.0 - GIVEN_BACK * (1.0 - found.left):
        raise NotEnoughExcitation(
            f"with the ripple compensated by the drive {100 * share:.0f} % of it are still there, where "
            f"{100 * found.left:.0f} % were predicted from trial waves; what the drive adds is not what it was told"
        )
    more = correction(left, found.influence)
    waves = {order: wave + more[order] for order, wave in found.waves.items()}
    return replace(found, waves=waves, left=remaining(left, found.influence, more) * share)


def _must_agree(found: Alignment) -> None:
    """The ripple that the axis shows is the one of the model. Raises NotEnoughExcitation."""
    if math.isnan(found.ratio):
        return  # the model's orders are not those of the axis: its sizes were taken, and the trials agree
    if found.agreement < ALIKE or not 1.0 / RATIO < found.ratio < RATIO:
        raise NotEnoughExcitation(
            f"what the axis asks for is {found.ratio:.2f} times the ripple of the model and agrees with it by "
            f"{found.agreement:.2f} (1 is alike, {ALIKE:g} the least): check the drive's torque constant, and "
            "whether the ripple is that of the motor's turn"
        )


def _trial(session: Session, waves: Mapping[int, complex]) -> dict[int, float]:
    """Amplitudes of the trial waves: as large as the ripple, and never much of the torque limit [N m]."""
    sizes = {order: abs(wave) for order, wave in waves.items()}
    share = min(1.0, TRIAL_SHARE * session.limits.torque / max(sum(sizes.values()), 1e-30))
    return {order: share * size for order, size in sizes.items()}


def _must_fit(session: Session, highest: int) -> None:
    """Room and machine time for all sweeps. Raises ConfigurationError."""
    sweep = sweep_of(session.motion, highest)
    sweep.requirements(session.limits)
    needed = SWEEPS * sweep.duration + committed_seconds(session.motion, session.axis.benchmark)
    if needed > session.budget.left:
        raise ConfigurationError(
            f"to align it, and to measure after writing, takes {needed:.0f} s of machine time, and "
            f"{session.budget.left:.0f} s are left; 'autotune run' with --only commit has the whole of "
            "limits.machine_seconds for it"
        )


def _lines(session: Session, name: str, orders: Collection[int]) -> tuple[Lines, float]:
    """Lines of the tracking error in one sweep, and how far those of two sweeps alike may be apart."""
    rows, _ = session.play(f"ripple-{name}", [sweep_of(session.motion, max(orders))])
    parts = {segment.experiment: part for segment, part in rows.split()}
    sides = [_side(parts[label], list(orders)) for label in (FORWARD, BACKWARD)]
    lines = {order: (sides[0][0][order], sides[1][0][order]) for order in orders}
    return lines, max(side[1] for side in sides)


def _side(rows: Recording, orders: list[int]) -> tuple[dict[int, complex], float]:
    position, error = rows["position"], rows["reference"] - rows["position"]
    lines = lines_of(position, error, orders)
    waves = sum(np.real(line * np.exp(1j * order * position)) for order, line in lines.items())
    rest = error - waves
    return lines, float(np.std(rest)) * float(np.sqrt(4.0 / len(error)))


@contextmanager
def _written(session: Session, values: Mapping[str, float], held: Mapping[str, float]) -> Iterator[None]:
    """Trial waves in the drive's volatile memory; what it held is written back, and the journal knows of both."""
    journal = session.journal
    changed, during = journal.state.changed, journal.state.during
    before = {name: value for name, value in held.items() if name != GAIN}
    own = changed.get(GAIN, held.get(GAIN, 0.0))
    journal.note(changed={**changed, **before, GAIN: own}, during={**during, **values})
    try:
        write_verified(session.loop, values)
        yield
    finally:
        write_verified(session.loop, {**before, GAIN: 0.0})
        journal.note(changed=changed, during=during)


def removed(session: Session, plan: RipplePlan) -> float:
    """Share of the lines at the model's orders and their neighbours that is gone now, with what is in the drive."""
    after, _ = _lines(session, "committed", plan.rest)
    return 1.0 - size_of(after) / size_of(plan.rest)


def enough(share: float, plan: RipplePlan) -> bool:
    """At least half of what was predicted."""
    return share >= GIVEN_BACK * (1.0 - plan.alignment.left)
