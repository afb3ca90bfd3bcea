"""The feedforward of a drive model as a short list of statements, the same for every target language.

    T = J r̈ + σ0 z + σ1 ż + b(ṙ) ṙ + Σ W_i z_i / d_i + F_g + ripple(r) + imbalance(r) + spring(r)

with r half a sample ahead of the reference, ż of (3.10) and z by (5.8): the law of
`control.model_feedforward`, written down once more so that it can be printed as C or structured text. A wave
s·sin(N r) + c·cos(N r) is A·sin(N r + φ) here, with A = √(s² + c²) and φ = atan2(c, s).
Statements are in a small subset of Python's syntax: assignments, `if`, + − * /, comparisons, and the
functions in `FUNCTIONS`. Only what a model has is in its law. Names in capitals are constants.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from autotune.control.model_feedforward import fed_forward
from autotune.models import layout
from autotune.models.contact import LEAST_DEFLECTION, LEAST_SHARE
from autotune.models.drive_model import DriveModel, surface_parameter
from autotune.models.position_dependent_friction import LEAST_FACTOR
from autotune.models.reversal_memory import ELEMENTS
from autotune.models.torque_ripple import LINES, scale_slot

FUNCTIONS = ("exp", "sin", "pow", "abs", "min", "max")
_TRAVEL = "travel = PERIOD * velocity"
LEAST_SLIP = 1e-12
"""Of the limit in one sample, below which the contact stays as it is."""


@dataclass(frozen=True, slots=True)
class Constant:
    """A number of the law, in its unit, with a few words for people."""

    name: str
    value: float
    unit: str
    meaning: str


@dataclass(frozen=True, slots=True)
class State:
    """What the law remembers from sample to sample; begins at 0."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True, slots=True)
class Block:
    """Statements that belong together, and what they are for."""

    about: str
    statements: str


@dataclass(frozen=True, slots=True)
class Law:
    """Constants, states, and statements from `position, velocity, acceleration` to `torque`."""

    constants: tuple[Constant, ...]
    states: tuple[State, ...]
    blocks: tuple[Block, ...]


def feedforward_law(model: DriveModel, period: float) -> Law:
    """The law of everything in the model that can be fed forward, at a sample period [s]."""
    return _Writer(fed_forward(model), period).law()


class _Writer:
    """Goes through a model from the contact to the sum, and notes constants as they are needed."""

    def __init__(self, model: DriveModel, period: float) -> None:
        self._model, self._period = model, period
        self._p = model.pack().p
        self._constants: dict[str, Constant] = {}

    def law(self) -> Law:
        blocks = tuple(self._blocks())
        if not any("place" in block.statements for block in blocks[1:]):
            blocks = (Block("Nothing depends on the place.", _TRAVEL), *blocks[1:])
        return Law(tuple(self._constants.values()), tuple(self._states()), blocks)

    def _blocks(self) -> Iterator[Block]:
        motion, torque = self._model.motion_unit, self._model.torque_symbol
        self._note("PERIOD", self._period, "s", "sample period")
        self._note("INERTIA", self._model["inertia"], self._model.unit("inertia"), "all that is accelerated")
        yield Block(
            f"The torque is held for a sample, so the place is half a sample ahead [{motion}].",
            f"place = position + 0.5 * PERIOD * velocity\n{_TRAVEL}",
        )
        yield Block(f"Level of friction at this speed and place [{torque}].", "\n".join(self._level()))
        yield Block("The contact bends with the motion and slides at its limit.", "\n".join(self._bristle()))
        yield Block(f"Viscous friction [{torque}].", "\n".join(self._viscous()))
        if "reversal_memory" in self._model:
            yield Block("Elastic elements that remember where the motion turned.", "\n".join(self._memory()))
        yield Block("What depends on the place alone.", "\n".join(self._outside()))
        yield Block("The whole.", "torque = INERTIA * acceleration + friction + outside")

    def _states(self) -> Iterator[State]:
        unit = self._model.motion_unit
        yield State("bristle", unit, "deflection of the contact")
        for i in self._elements():
            yield State(f"memory_{i}", unit, f"deflection of element {i}")

    def _level(self) -> Iterator[str]:
        self._value("COULOMB", "coulomb")
        yield "level = COULOMB"
        if "stribeck" in self._model:
            yield from self._stribeck()
        if "direction_asymmetry" in self._model:
            self._value("ASYMMETRY_COULOMB", "direction_asymmetry.coulomb")
            yield "if velocity >= 0.0:\n    level = level + ASYMMETRY_COULOMB"
            yield "else:\n    level = level - ASYMMETRY_COULOMB"
        if "position_dependent_friction" in self._model:
            yield from self._place_factor()
        least = LEAST_SHARE * self._model["coulomb"]
        self._note("LEAST_LEVEL", least, self._model.torque_symbol, "friction never falls below")
        self._note("LEAST_DEFLECTION", LEAST_DEFLECTION, self._model.motion_unit, "limit never falls below")
        self._value("STIFFNESS", "stiffness")
        yield "limit = max(max(level, LEAST_LEVEL) / STIFFNESS, LEAST_DEFLECTION)"

    def _stribeck(self) -> Iterator[str]:
        rise = self._model["break_away"] - self._model["coulomb"]
        self._note("STRIBECK_RISE", rise, self._model.torque_symbol, "break-away torque less Coulomb's")
        self._value("STRIBECK_VELOCITY", "stribeck_velocity")
        exponent = float(self._p[surface_parameter("stribeck_exponent").slot])
        yield "ratio = abs(velocity) / STRIBECK_VELOCITY"
        if exponent == 2.0:
            yield "level = level + STRIBECK_RISE * exp(-(ratio * ratio))"
        else:
            self._note("STRIBECK_EXPONENT", exponent, "1", "shape of the fall")
            yield "level = level + STRIBECK_RISE * exp(-pow(ratio, STRIBECK_EXPONENT))"

    def _place_factor(self) -> Iterator[str]:
        slot = layout.block("position_dependent_friction")
        height, centre, width, order, sine, cosine = (float(x) for x in self._p[slot : slot + 6])
        unit = self._model.motion_unit
        yield "factor = 1.0"
        if height != 0.0:
            self._note("SPOT_HEIGHT", height, "1", "relative rise of friction at the spot")
            self._note("SPOT_CENTRE", centre, unit, "where the spot is")
            self._note("SPOT_WIDTH", width, unit, "how far it reaches")
            yield "ratio = (place - SPOT_CENTRE) / SPOT_WIDTH"
            yield "factor = factor + SPOT_HEIGHT * exp(-(ratio * ratio))"
        if order > 0.0:
            yield from self._wave("FRICTION_WAVE", "factor", order, sine, cosine, "1")
        self._note("LEAST_FACTOR", LEAST_FACTOR, "1", "a place never takes friction below this share")
        yield "level = level * max(factor, LEAST_FACTOR)"

    def _bristle(self) -> Iterator[str]:
        self._value("MICRO_DAMPING", "micro_damping")
        self._note("LEAST_SLIP", LEAST_SLIP, "1", "less than this of the limit in a sample is no motion")
        yield "slip = abs(travel) / limit"
        yield (
            "if slip >= LEAST_SLIP:\n"
            "    steady = limit\n"
            "    if velocity < 0.0:\n"
            "        steady = -limit\n"
            "    bristle = steady + (bristle - steady) * exp(-slip)"
        )
        yield "rate = velocity - abs(velocity) / limit * bristle"
        yield "friction = STIFFNESS * bristle + MICRO_DAMPING * rate"

    def _viscous(self) -> Iterator[str]:
        self._value("VISCOUS", "viscous")
        yield "coefficient = VISCOUS"
        if "direction_asymmetry" in self._model:
            self._value("ASYMMETRY_VISCOUS", "direction_asymmetry.viscous")
            yield "if velocity >= 0.0:\n    coefficient = coefficient + ASYMMETRY_VISCOUS"
            yield "else:\n    coefficient = coefficient - ASYMMETRY_VISCOUS"
        if "nonlinear_viscous" in self._model:
            knee = self._model["nonlinear_viscous.knee"]
            power = 0.5 * (self._model["nonlinear_viscous.exponent"] - 1.0)
            unit = self._model.unit("nonlinear_viscous.knee")
            self._value("CURVED_TORQUE", "nonlinear_viscous.torque")
            self._note(
                "CURVED_KNEE_SQUARED", knee * knee, f"({unit})²", "below it friction is linear in speed"
            )
            self._note("CURVED_POWER", power, "1", "half of the exponent less 1")
            yield "bent = pow(velocity * velocity + CURVED_KNEE_SQUARED, CURVED_POWER)"
            yield "coefficient = coefficient + CURVED_TORQUE * bent"
        yield "friction = friction + coefficient * velocity"

    def _memory(self) -> Iterator[str]:
        for i in self._elements():
            limit = self._model[f"reversal_memory.displacement_{i}"]
            carried = self._model[f"reversal_memory.torque_{i}"] / limit
            self._value(f"ELEMENT_{i}_LIMIT", f"reversal_memory.displacement_{i}")
            self._note(f"ELEMENT_{i}_STIFFNESS", carried, self._model.unit("stiffness"), f"of element {i}")
            yield f"memory_{i} = min(max(memory_{i} + travel, -ELEMENT_{i}_LIMIT), ELEMENT_{i}_LIMIT)"
            yield f"friction = friction + ELEMENT_{i}_STIFFNESS * memory_{i}"

    def _elements(self) -> Iterator[int]:
        """Numbers of the hysteresis elements in use: up to the first without a displacement."""
        if "reversal_memory" not in self._model:
            return
        at = layout.block("reversal_memory")
        for i in range(ELEMENTS):
            if self._p[at + 2 * i] <= 0.0:
                return
            yield i + 1

    def _outside(self) -> Iterator[str]:
        torque = self._model.torque_symbol
        self._value("OFFSET", "offset")
        yield "outside = OFFSET"
        if "torque_ripple" in self._model:
            at = layout.block("torque_ripple")
            for i in range(LINES):
                order, sine, cosine = (float(x) for x in self._p[at + 3 * i : at + 3 * i + 3])
                if order == 0.0:
                    break
                yield from self._wave(f"RIPPLE_{i + 1}", "outside", order, sine, cosine, torque)
        if "gravity_imbalance" in self._model:
            at = layout.block("gravity_imbalance")
            sine, cosine, order = (float(x) for x in self._p[at : at + 3])
            yield from self._wave("IMBALANCE", "outside", order, sine, cosine, torque)
        if "spring" in self._model:
            self._value("SPRING", "spring.stiffness")
            yield "outside = outside + SPRING * place"

    def _wave(
        self, name: str, total: str, order: float, sine: float, cosine: float, unit: str
    ) -> Iterator[str]:
        angle = order * float(self._p[scale_slot()])
        per = "1" if self._model.motion_unit == "rad" else "rad/m"
        self._note(f"{name}_ORDER", angle, per, f"angle of the wave per {self._model.motion_unit} of travel")
        self._note(f"{name}_AMPLITUDE", math.hypot(sine, cosine), unit, "its size")
        self._note(f"{name}_PHASE", math.atan2(cosine, sine), "rad", "its angle at place 0")
        yield f"{total} = {total} + {name}_AMPLITUDE * sin({name}_ORDER * place + {name}_PHASE)"

    def _value(self, name: str, surface: str) -> None:
        meaning = surface_parameter(surface).meaning
        self._note(name, self._model[surface], self._model.unit(surface), meaning)

    def _note(self, name: str, value: float, unit: str, meaning: str) -> None:
        if not math.isfinite(value):
            raise ValueError(f"{name} is {value}")
        self._constants[name] = Constant(name, value, unit, meaning)
