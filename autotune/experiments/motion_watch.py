"""Motion that must be there: torque and encoder are held against each other, in every mode.

An encoder that has died tells a rest that is none: the controller pushes harder, or in torque mode the
axis slides away unseen. Two virtual axes run beside the real one, in each direction, and begin anew
whenever the encoder moves.

The *laziest* that the axis can be: heaviest inertia J⁺, held by `must`, more than has ever held it.
Where even that one had moved some counts in the direction of the push and the encoder has not,

    ∫∫ (T − must)/J⁺ > (LAZY_COUNTS + 1)·resolution,

encoder, motor or mechanics are not what they seem: blocked, dead, or its sign is wrong. This stop is
certain, whatever the axis.

The *lightest*: smallest inertia J⁻, held by no more than `may`, a torque that holds it for sure. Where it
could have become too fast, or could stop only outside the travel, while the encoder has been silent,

    v⁻ = ∫ (T − may)/J⁻ > limits.speed   or   q + ∫v⁻ + v⁻²/2a outside,

the axis is stopped: it may be running. This bound is kept whatever the encoder does; an axis that truly
sticks under so much torque for so long cannot be told from one that runs, and is stopped too.

A reference that rests asks for no motion, but an integrator pushes an axis that holds, against an error that
an encoder dead there keeps as it is: there the lightest axis moves where it is pushed, and does not coast. A
loop that swings is told by `swing_watch`.

`must` and `may` come from the axis's own inverse (`inverse_estimate`), see `_levels`; before that is
known, from the limits: J = torque/deceleration, no friction, and a motion that was asked for.
"""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass, replace

from autotune.core.axis import Limits
from autotune.core.drive import Mode
from autotune.experiments.fine_inertia import FineInertia
from autotune.experiments.inverse_estimate import Inverse, InverseEstimate
from autotune.experiments.momentum_watch import (
    EXCESS_SECONDS,
    MOVING,
    ExcessWatch,
    MomentumWatch,
    early_levels,
)
from autotune.experiments.swing_watch import SwingWatch
from autotune.experiments.virtual_axes import VirtualAxes

ALIVE_COUNTS = 1.5  # a flicker of one count is no sign of life
FIRST_MAY = 0.2  # of limits.torque beyond the first torque, before more is known
FIRST_MUST = 0.6  # of limits.torque beyond the first torque: what no axis needs to break loose
MOST_MUST = 0.9  # of limits.torque: at full torque something must move
MUST_BEYOND = 1.0  # friction levels beyond what holds: tight spots, long rests
LEAST_BEYOND = 0.05  # of limits.torque
LATER_MUST = 0.2  # of limits.torque beyond what has slid it in this direction
MAY_BEYOND = 0.5  # friction levels beyond what slides: what sticks holds more
SEEN_BEYOND = (
    0.15  # the same after so many reversals (STROKES), beside what was seen to stick; linear between
)
STICKS_BEYOND = 1.2  # times the largest torque beyond what slides that was seen to stick
STROKES = 6
TORQUE_PART = 0.7  # of friction beside the first torque: what may be commanded without motion, for ever
LIGHT = 1.0  # of torque/deceleration: the lightest axis before its inertia is known
LATER_LIGHT = 0.4  # the same after STROKES, where its inertia is still not known
LIGHT_PART = 0.5  # of the inertia found
HEAVY = 2.0  # times torque/deceleration: the heaviest axis that can brake as its file says
HEAVY_PART = 3.0  # times the inertia found
FINE_LIGHT, FINE_HEAVY = 0.4, 2.4  # times the inertia from small motion, where the large has shown none
AGREES = 0.5  # large and small motion show the same inertia
HEAVY_SWING = 4.0  # times the inertia from small motion: beyond, a swing tells of something else
OVERSTATED = 1.2  # by which limits.deceleration may exceed what torque and friction can do
STICKS_SECONDS = 0.005  # without a count: the axis sticks
FORGET = 0.995  # of the largest sticking torque, each time it breaks loose


@dataclass(frozen=True, slots=True)
class Learnt:
    """What one programme has found out about its axis, for the next one of the same session.

    Attributes:
        scales: limits, cycle and resolution that it was learnt with; with others it means nothing.
        estimate: of the inverse; sticks: torque beyond what slides it that was seen to hold it.
        fine: inertia from small motion.
    """

    scales: tuple[Limits, float, float]
    estimate: InverseEstimate
    sticks: float
    fine: FineInertia


class MotionWatch:
    """Watches one axis; pure apart from what it remembers.

    Args:
        limits: in force.
        period: cycle [s].
        resolution: of the encoder [rad or m].
        learnt: by an earlier watch of the same session; taken over only where its scales are these.
    """

    __slots__ = (
        "_blind",
        "_broke",
        "_count",
        "_down",
        "_estimate",
        "_excess",
        "_fine",
        "_first",
        "_held",
        "_limits",
        "_mode",
        "_momentum",
        "_moved",
        "_order",
        "_period",
        "_position",
        "_reference",
        "_silence",
        "_sticks",
        "_swing",
        "_torque",
        "_up",
    )

    def __init__(
        self, limits: Limits, period: float, resolution: float, learnt: Learnt | None = None
    ) -> None:
        self._blind = False
        self._limits = limits
        self._period = period
        self._count = resolution
        self._estimate = InverseEstimate(limits, period, resolution)
        self._held = 0.0
        self._fine = FineInertia(limits.torque, period, resolution)
        if learnt is not None and learnt.scales == (limits, period, resolution):
            self._estimate, self._held = deepcopy(learnt.estimate), learnt.sticks
            self._fine = deepcopy(learnt.fine)
        self._momentum = MomentumWatch(limits, period, resolution)
        self._order = limits.torque / limits.deceleration
        self._excess = ExcessWatch(self._order)
        self._swing = SwingWatch(limits.torque, self._order, resolution)
        self._sticks = STICKS_SECONDS
        self._broke = (
            0.0,
            0.0,
        )  # torques that it broke loose at upwards and downwards, before anything slid it there
        self._up, self._down = VirtualAxes(), VirtualAxes()
        self._mode = Mode.POSITION
        self._first = self._torque = 0.0
        self.begin(Mode.POSITION, 0.0, 0.0, 0.0)

    @property
    def learnt(self) -> Learnt:
        """What is known of the axis now."""
        return Learnt((self._limits, self._period, self._count), self._estimate, self._held, self._fine)

    @property
    def doubtful(self) -> bool:
        """Whether the encoder may not show what the axis does: it was found so, or it is silent where it must not be.

        An axis that was moving a moment ago, or is pushed hard, may run on unseen; braking by its encoder would
        drive it.
        """
        fastest = max(self._up.run, self._down.run)
        return (
            self._blind
            or self._momentum.doubtful
            or (self._silence > 0.0 and fastest * self._period > ALIVE_COUNTS * self._count)
        )

    def begin(self, mode: Mode, position: float, reference: float, torque: float) -> None:
        """Power came on; what is known of the axis stays."""
        self._mode = mode
        self._position = position
        self._reference = reference
        self._first = self._torque = torque
        self._silence = 0.0
        self._moved = mode is not Mode.POSITION
        self._up.still()
        self._down.still()
        self._estimate.restart(position)
        self._fine.restart()
        self._momentum.begin(position)
        self._excess.begin(reference)
        self._swing.begin(position, reference, torque)
        self._levels()

    def check(self, position: float, reference: float, torque: float, cycle: float) -> str:
        """One cycle: it ended at `position`; `torque` is the demand that acts from now on.

        Returns why the axis must be stopped (torque without the motion that belongs to it), or nothing.
        """
        acting, self._torque = self._torque, torque
        if self._estimate.add(position, acting, cycle):
            self._levels()
            if why := self._overstated():
                return why
        if missing := self._momentum.check(position, acting, cycle, cycle > 1.5 * self._period):
            return self._short(missing, acting)
        if self._mode is Mode.POSITION:
            if self._excess.check(reference, acting, cycle):
                return self._unasked(acting)
            fine = self._fine
            if fine.add(position, acting, cycle) and (fine.inertia or fine.quiet):
                self._swing.weigh(HEAVY_SWING * fine.inertia or math.inf, not fine.inertia)
                self._levels()
            if heavy := self._swing.check(position, reference, acting, cycle):
                return self._swings(heavy)
        moved, count = position - self._position, self._count
        if moved > ALIVE_COUNTS * count or moved < -ALIVE_COUNTS * count:
            self._alive(position, reference, acting, cycle)
            if self._mode is Mode.POSITION:
                self._up.idle()
                self._down.idle()
                return ""
        else:
            self._silence += cycle
            self._moved |= abs(reference - self._reference) > 2.0 * count
        up, down = self._up, self._down
        why = ""
        if acting > up.may or (up.run > 0.0 and (up.pushed or self._moved)):
            why = self._push(up, 1.0, acting, position, cycle)
        else:
            up.idle()
        if -acting > down.may or (down.run > 0.0 and (down.pushed or self._moved)):
            why = why or self._push(down, -1.0, acting, position, cycle)
        else:
            down.idle()
        return why

    def _alive(self, position: float, reference: float, torque: float, cycle: float) -> None:
        """A count has come: everything that was assumed meanwhile is known now."""
        moved, count = position - self._position, self._count
        silence = self._silence + cycle
        if silence > self._sticks and self._mode is not Mode.TORQUE:
            self._stuck(torque, moved)
        self._up.live((moved - ALIVE_COUNTS * count) / silence)
        self._down.live((-moved - ALIVE_COUNTS * count) / silence)
        self._position, self._reference, self._silence = position, reference, 0.0
        self._moved = self._mode is not Mode.POSITION

    def _stuck(self, torque: float, moved: float) -> None:
        """It has broken loose: so much torque can hold it."""
        inverse, (up, down) = self._estimate.inverse, self._broke
        if inverse.up is None or inverse.down is None:
            if torque * moved > 0.0 and (torque > up or -torque > down):
                self._broke = max(torque, up), max(-torque, down)
                self._levels()
            return
        beyond = max(torque - inverse.up, inverse.down - torque, 0.0)
        if beyond > self._held:
            self._held = beyond
            self._levels()
        else:
            self._held *= FORGET

    def _push(self, way: VirtualAxes, sign: float, torque: float, position: float, cycle: float) -> str:
        limits = self._limits
        way.light(sign * torque, cycle)
        # what is demanded now acts for a cycle more before any stop does
        run = max(way.run + (sign * self._torque - way.may) / way.lightest * cycle, 0.0)
        end = sign * position + way.way + run * cycle + run * run / (2.0 * limits.deceleration)
        edge = limits.position_max if sign > 0.0 else -limits.position_min
        if (run > limits.speed or end > edge) and self._silence > 0.0:
            return self._unseen(way, torque)
        speed = (sign * self._momentum.way - self._count) / (MOVING * self._period)
        if way.lazy(sign * torque, sign * position, speed, self._count, cycle):
            return self._dead(sign, torque)
        return ""

    def _levels(self) -> None:
        """What the virtual axes are, from what is known now."""
        inverse, limit, order = self._estimate.inverse, self._limits.torque, self._order
        friction, seen = inverse.friction, inverse.strokes > STROKES
        lightest, heaviest = (LATER_LIGHT if seen else LIGHT) * order, HEAVY * order
        share, fine, bounds = _sticks_share(inverse.strokes), self._fine.inertia, self._inertia(inverse)
        if bounds is not None and friction is not None:
            lightest, heaviest = LIGHT_PART * bounds[0], min(heaviest, HEAVY_PART * bounds[1])
        elif fine:
            lightest = min(lightest, LIGHT_PART * fine)
            bounds = (FINE_LIGHT * fine, FINE_HEAVY * fine)
        if bounds is not None and friction is not None:
            told = replace(inverse, inertia=bounds[0], heaviest=bounds[1])
            self._momentum.know(told, max(STICKS_BEYOND * self._held, share * friction))
        self._swing.know(friction)
        self._excess.heaviest = min(order, HEAVY_SWING * fine) if fine else order
        ways = ((self._up, 1.0, inverse.up, self._broke[0]), (self._down, -1.0, inverse.down, self._broke[1]))
        for way, sign, level, broke in ways:
            way.lightest, way.heaviest = lightest, heaviest
            first = sign * self._first
            if level is None or friction is None:
                slides = max(first, broke if level is None else sign * level)
                way.may = slides + FIRST_MAY * limit
                way.must = min(
                    max(first + FIRST_MUST * limit, slides + LATER_MUST * limit), MOST_MUST * limit
                )
                continue
            beyond = max(STICKS_BEYOND * self._held, share * friction)
            way.may = held = sign * level + beyond
            if self._mode is Mode.TORQUE:
                way.may = min(first + TORQUE_PART * friction, sign * level)
            beyond = max(MUST_BEYOND * friction, LEAST_BEYOND * limit)
            way.must = min(held + beyond, MOST_MUST * limit)
        if seen and friction is not None and inverse.inertia is None:
            more = LATER_MUST * limit  # where small motion shows the inertia, momentum tells the rest
            more = more if fine else max(more - MUST_BEYOND * friction, 0.0)
            self._excess.know(self._up.must + more, self._down.must + more)
        elif inverse.inertia is None or friction is None:
            self._excess.know(*early_levels(inverse, self._first, self._limits), early=True)
        else:
            self._excess.know(math.inf, math.inf)
        self._momentum.suppose(self._up.must, self._down.must)

    def _inertia(self, inverse: Inverse) -> tuple[float, float] | None:
        """The lightest and the heaviest that it can be, where that is certain: from large and small motion, if they
        agree, each being an estimate of its own; or from large motion alone after some strokes."""
        large, small = inverse.inertia, self._fine.inertia
        if large is None:
            return None
        if AGREES * small <= large <= small / AGREES:
            return min(large, small), max(inverse.heaviest, small)
        return (large, inverse.heaviest) if inverse.strokes > STROKES else None

    def _overstated(self) -> str:
        """The guard stops in time only if the axis brakes as its file says.

        Friction that builds up over every stroke looks like inertia, however often: where small motion shows one, both
        must say the same.
        """
        inverse, friction = self._estimate.inverse, self._estimate.inverse.friction
        if inverse.inertia is None or friction is None or inverse.lightest <= 0.0:
            return ""
        fine = self._fine.inertia
        able = (self._limits.torque + friction) / (min(inverse.lightest, fine) or inverse.lightest)
        sure = inverse.strokes > STROKES or fine > inverse.lightest
        if sure and able * OVERSTATED < self._limits.deceleration:
            return (
                f"by torque and motion this axis brakes with {able:.4g} at most, but limits.deceleration says "
                f"{self._limits.deceleration:.4g}, and every stop is planned with it; check the encoder's "
                "counts per revolution and the unit of torque, or lower limits.deceleration"
            )
        return ""

    def _short(self, missing: float, torque: float) -> str:
        self._blind = True
        return (
            f"the encoder shows {abs(missing):.4g} less speed than the torque must have given (now {torque:.4g}): it "
            "tells only a part of the motion (lost pulses, a coupling that slips) or counts the wrong way, or "
            "something has stopped the axis, drives it or has been put on it; check encoder, coupling and cable, and "
            "make sure that the axis moves freely"
        )

    def _unasked(self, torque: float) -> str:
        self._blind = True
        return (
            f"the controller has demanded {torque:.4g} for {EXCESS_SECONDS * 1e3:.0f} ms, more than this axis has ever "
            "needed and its reference asks for: its loop swings, something pushes or holds it, or the encoder tells "
            "only a part of the motion; check gains, encoder and coupling, and make sure that the axis moves freely"
        )

    def _swings(self, inertia: float) -> str:
        self._blind = True
        return (
            f"the loop swings, and by torque and motion the axis has an inertia of {inertia:.4g} in it, far more than "
            "before, or it has begun to swing all at once: the encoder tells only a part of the motion (lost pulses, a "
            "coupling that slips), or something has been put on the axis; check encoder, coupling and cable, and make "
            "sure that the axis moves freely"
        )

    def _unseen(self, way: VirtualAxes, torque: float) -> str:
        self._blind = True
        return (
            f"a torque of {torque:.4g} acts and the encoder has been silent for {self._silence * 1e3:.0f} ms; "
            f"if it is dead, the axis may run with {way.run:.4g} by now (limits.speed allows "
            f"{self._limits.speed:.4g}) and be {way.way:.4g} away; check encoder and cable, look for a blocked "
            "axis, and make sure that the axis moves freely"
        )

    def _dead(self, sign: float, torque: float) -> str:
        self._blind = True
        where = "upwards" if sign > 0.0 else "downwards"
        return (
            f"a torque of {torque:.4g} pushes {where} and the encoder does not show the motion that belongs to "
            "it: the encoder is dead or counts the wrong way, its sign or the motor's is wrong, or the axis is "
            "blocked; check encoder, cable and mechanics, or raise limits.torque if the axis needs so much to "
            "break loose"
        )


def _sticks_share(strokes: int) -> float:
    """Friction levels beyond what slides the axis that may stick it: each reversal has shown some more of it."""
    return MAY_BEYOND - (MAY_BEYOND - SEEN_BEYOND) * min(strokes / STROKES, 1.0)
