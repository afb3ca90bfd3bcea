"""The structures of the catalogue: what each is, what it costs to have, and how it is run on the twin of an axis."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from autotune.control.adaptation import AdaptationGains, Bounds
from autotune.control.feedforward import LugreParameters
from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.twin import Motion, with_damping
from autotune.control.model_feedforward import torque_along
from autotune.control.structures import laws
from autotune.core.arrays import Floats
from autotune.models import layout
from autotune.models.drive_model import DriveModel
from autotune.models.layout import POSITION
from autotune.models.plant import substeps_for
from autotune.models.stribeck import STRIBECK
from autotune.models.total_friction import damping_at_rest, stiffness_at_rest, total_friction

LARGER = 10.0 / 3.0
"""Gains of the loop with an observed velocity over those of PID, as in Table 6.3."""


@dataclass(frozen=True, slots=True)
class Structure:
    """One entry of the catalogue.

    Attributes:
        kind: the law's number (`laws`).
        effort: what must be known before it runs.
        integral, larger: parts of the axis's gains that it uses.
        in_host: it closes a loop on friction through the host: shown on the twin, never offered for the axis.
        source: of the thesis.
    """

    name: str
    kind: int
    effort: str
    integral: bool = True
    larger: float = 1.0
    in_host: bool = False
    source: str = ""


NONE, ADAPTED, IDENTIFIED, DIAGNOSED = (
    "none",
    "some minutes of adaptation",
    "identification",
    "identification and diagnosis",
)
EFFORTS = (NONE, ADAPTED, IDENTIFIED, DIAGNOSED)
"""Rising."""
STRUCTURES: tuple[Structure, ...] = (
    Structure("PD", laws.PID, NONE, integral=False, source="(4.67)"),
    Structure("PID", laws.PID, NONE, source="(4.67)"),
    Structure("kinetic feedforward", laws.KINETIC_FEEDFORWARD, IDENTIFIED, source="(5.1)"),
    Structure("LuGre feedforward", laws.LUGRE_FEEDFORWARD, IDENTIFIED, source="(5.2)"),
    Structure("adaptive LuGre feedforward", laws.ADAPTIVE_FEEDFORWARD, ADAPTED, source="(5.14)"),
    Structure("diagnosed model's feedforward", laws.PLAYED_FEEDFORWARD, DIAGNOSED),
    Structure("Lund-Grenoble observer", laws.LUND_GRENOBLE, IDENTIFIED, in_host=True, source="(5.17)"),
    Structure("Luenberger observer", laws.LUENBERGER, IDENTIFIED, True, LARGER, True, "(5.23)"),
    Structure(
        "Luenberger observer, slowed", laws.LUENBERGER_SLOWED, IDENTIFIED, True, LARGER, True, "(5.29)"
    ),
    Structure("Luenberger observer, exact", laws.LUENBERGER_EXACT, IDENTIFIED, True, LARGER, True, "(5.32)"),
    Structure("kinetic linearisation", laws.KINETIC_LINEARISED, IDENTIFIED, False, 1.0, True, "(5.34)"),
    Structure("LuGre linearisation", laws.LUGRE_LINEARISED, IDENTIFIED, in_host=True, source="(5.39)"),
)


@dataclass(frozen=True, slots=True)
class Bench:
    """What all structures are run with.

    Attributes:
        model: of the structures; the twin may be another member of the family.
        lugre: the axis as one bristle, for those that know LuGre only.
        gains: of today's PID.
        frequency: of the benchmark, which the adaptation's gains follow [Hz].
    """

    model: DriveModel
    lugre: LugreParameters
    gains: Gains
    timing: LoopTiming
    frequency: float
    own: Floats = field(default_factory=lambda: np.zeros(5))


def bristle_of_all(model: DriveModel) -> LugreParameters:
    """All friction and stiffness in one bristle; what a LuGre structure starts from."""
    level = max(total_friction(model).value, 1e-9)
    falls = STRIBECK.name in model
    excess = model["break_away"] - model["coulomb"] if falls else 0.0
    return LugreParameters(
        inertia=model["inertia"],
        viscous=model["viscous"],
        coulomb=level,
        stiffness=max(stiffness_at_rest(model), 1e-9),
        micro_damping=damping_at_rest(model),
        offset=model["offset"],
        break_away=max(level + excess, 1e-9),
        stribeck_velocity=model["stribeck_velocity"] if falls else 1.0,
    )


def own_numbers(lugre: LugreParameters, gains: Gains, timing: LoopTiming, correction: float = 0.0) -> Floats:
    """Numbers of the observers: l1 twice what (5.26) asks for, as far as the cycle can hold it; v_l of (5.30)."""
    h = timing.period
    own = np.zeros(5)
    damping = (lugre.micro_damping + lugre.viscous) / lugre.inertia
    own[laws.CORRECTION] = correction
    own[laws.L1] = min(max(2.0 * damping, 0.2 / h), max(0.9 / h - damping, 0.1 / h))
    own[laws.DAMPING] = LARGER * gains.kd
    own[laws.SLOW_SPEED] = 0.2 * math.pi / h * lugre.coulomb / lugre.stiffness
    own[laws.DEAD_ZONE] = 0.5 * timing.resolution / h
    return own


def run(
    structure: Structure,
    bench: Bench,
    twin: DriveModel,
    timing: LoopTiming,
    reference: Floats,
) -> tuple[Motion, LugreParameters]:
    """One structure on one twin along a reference [rad], shape (n,); also what adaptation has made of LuGre."""
    h, gains = timing.period, bench.gains
    smooth = reference_rates(reference, h)
    scale, observed = structure.larger, laws.LUENBERGER <= structure.kind <= laws.LUENBERGER_EXACT
    values = gains.array(h)
    values[:3] *= scale
    values[1] *= 0.0 if observed else 1.0
    if not structure.integral:  # of a cascade both loops are proportional then
        values[0], values[2], values[4] = values[0] * values[4], 0.0, 1.0
    packed = with_damping(twin, timing)
    state = np.zeros(layout.STATES)
    state[POSITION] = reference[0]
    loop = np.array(
        [h, timing.torque_limit, timing.resolution, timing.dead_time, 0.0, 0.0, reference[0], reference[0]]
    )
    start = twin["offset"] if structure.integral and structure.kind == laws.PID else 0.0
    constant = values[0] * (1.0 - values[4]) * reference[0]
    loop[4] = (start + constant) / values[2] if values[2] > 0.0 else 0.0
    depth = int(timing.dead_time / h + 1e-9) + 2
    n = len(reference)
    played = np.zeros(n)
    if structure.kind == laws.PLAYED_FEEDFORWARD:
        played = torque_along(bench.model, smooth[:, 0], smooth[:, 1], smooth[:, 2], h)
    if structure.name == "PD":
        played = np.full(n, bench.model["offset"])
    f = bench.lugre.array()
    seen = np.zeros(2)
    if observed:
        seen[0] = -bench.own[laws.L1] * reference[0]
    position, torque = np.empty(n), np.empty(n)
    count = laws.run_structure(
        packed.p, packed.on, state, values, loop, np.full(depth, twin["offset"]),
        substeps_for(packed.p, h, packed.on), structure.kind, f, bench.own, seen, _adaptation(bench),
        smooth, played, position, torque,
    )  # fmt: skip
    position[count:], torque[count:] = np.nan, np.nan
    adapted = LugreParameters.from_array(f) if structure.kind == laws.ADAPTIVE_FEEDFORWARD else bench.lugre
    return Motion(reference, position, torque, count, h), adapted


def reference_rates(reference: Floats, period: float) -> Floats:
    """r with its central differences, shape (n, 3); at rest before and after."""
    wide = np.concatenate([reference[:1], reference, reference[-1:]])
    rate = (wide[2:] - wide[:-2]) / (2.0 * period)
    change = (wide[2:] - 2.0 * wide[1:-1] + wide[:-2]) / period**2
    return np.ascontiguousarray(np.column_stack([reference, rate, change]))


def _adaptation(bench: Bench) -> Floats:
    gains, omega = AdaptationGains(), 2.0 * math.pi * bench.frequency
    low, high = Bounds.around(
        bench.lugre, (bench.lugre.stiffness / 16.0, bench.lugre.stiffness * 2.0)
    ).arrays()
    return np.concatenate([[gains.stiffness, gains.coulomb * omega, gains.offset * omega], low, high])


def tuned(bench: Bench, lugre: LugreParameters) -> Bench:
    """The same with another bristle, and the observers' numbers for it."""
    own = own_numbers(lugre, bench.gains, bench.timing, float(bench.own[laws.CORRECTION]))
    return replace(bench, lugre=lugre, own=own)
