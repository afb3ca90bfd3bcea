"""The feedforward of a drive model as a short list of statements, the same for every target language.

    T = J r̈ + σ0 z + σ1(ṙ) ż + b(ṙ) ṙ + Σ W_i z_i / d_i + F_g + Σ torque(r)

with r and ṙ half a sample ahead of the reference, ż of (3.10) and z by (5.8): the law of `control.model_feedforward`.
The contact bends with the mean velocity up to there, so a level that changes with speed is asked for both speeds. The
frame is written here as it is in `models.contact`; what effects contribute is written down from their own kernels
(`kernels`). Before a law is given out it is run against the Python feedforward along the self-test's motion.

Statements are in a small subset of Python's syntax: assignments, `if`, + − * /, comparisons, and a few functions
(`kernels.MATHEMATICS`). Only what a model has is in its law. Names in capitals are constants.
"""

from __future__ import annotations

import ast
import math
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from autotune.control.model_feedforward import fed_forward
from autotune.core.errors import ConfigurationError
from autotune.export.kernels import Term, Writer, named
from autotune.export.self_test import self_test_rows
from autotune.models import layout
from autotune.models.contact import LEAST_DEFLECTION, LEAST_SHARE
from autotune.models.drive_model import WHOLE_BASE, DriveModel
from autotune.models.effect import Kind
from autotune.models.lugre import bends, crept, fallen, halfway, onward
from autotune.models.reversal_memory import (
    ATTRACTION,
    DAMPING,
    ELEMENT_STATES,
    REMEMBERS,
    memory_damping,
    memory_torque,
    more_to_carry,
)
from autotune.models.stribeck import EXPONENT, FALLS, TAIL
from autotune.models.table import EFFECTS
from autotune.models.torque_ripple import scale_slot

LEAST_SLIP = 1e-12
"""Of the limit in one sample, below which the contact stays as it is (`models.lugre.bristle_step`)."""
AGREES = 1e-9
"""Of the largest torque of the self-test: a law that is further from the Python feedforward is not given out."""
_SPEED = "speed = velocity + 0.5 * PERIOD * acceleration"
_TRAVEL = "travel = PERIOD * velocity"
_SCALE = "ANGLE_SCALE"


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
    """The law of everything in the model that can be fed forward, at a sample period [s].

    Raises:
        ConfigurationError: an effect acts where statements cannot follow it.
    """
    law = _Frame(fed_forward(model), period).law()
    rows = self_test_rows(model, period)
    error = float(np.max(np.abs(played(law, rows[:, :3].tolist()) - rows[:, 3])))
    if not error <= AGREES * max(float(np.max(np.abs(rows[:, 3]))), 1e-6):
        raise ConfigurationError(
            f"the law of this model cannot be written for another controller: it is {error:.2g} from the "
            "feedforward of this program; an effect of the model acts where an export does not follow"
        )
    return law


def played(law: Law, rows: list[list[float]]) -> Any:
    """Torque of a law's own statements along position, velocity and acceleration; shape (n,)."""
    code = compile("\n".join(block.statements for block in law.blocks), "law", "exec")
    known: dict[str, Any] = {name: getattr(math, name) for name in ("exp", "sin", "cos", "pow")}
    known |= {"abs": abs, "min": min, "max": max} | {c.name: c.value for c in law.constants}
    known |= {state.name: 0.0 for state in law.states}
    torque = []
    for row in rows:
        known["position"], known["velocity"], known["acceleration"] = row
        exec(code, known)  # noqa: S102 - statements that this module has just written
        torque.append(known["torque"])
    return np.array(torque)


class _Frame:
    """The contact and the sum around it; notes constants and states as they are needed."""

    def __init__(self, model: DriveModel, period: float) -> None:
        packed = model.pack()
        self._model, self._period, self._p, self._on = model, period, packed.p, packed.on
        self._constants: dict[str, Constant] = {}
        self._states = {"bristle": State("bristle", f"[{model.motion_unit}] deflection of the contact")}
        self._places = _places(model)

    def law(self) -> Law:
        blocks = tuple(self._blocks())
        used = _names("\n".join(block.statements for block in blocks))
        constants = tuple(one for name, one in self._constants.items() if name in used)
        return Law(constants, tuple(self._states.values()), blocks)

    def _blocks(self) -> Iterator[Block]:
        motion, torque = self._model.motion_unit, self._model.torque_symbol
        self._note("PERIOD", self._period, "s", "sample period")
        rest = tuple(self._after_travel())
        if any("place" in _names(block.statements) for block in rest):
            about = f"The torque is held for a sample: place [{motion}] and speed [{motion}/s] are half a sample ahead."
            yield Block(about, f"place = position + 0.5 * PERIOD * velocity\n{_SPEED}\n{_TRAVEL}")
        else:
            about = f"The torque is held for a sample: speed [{motion}/s] is half a sample ahead. No place is needed."
            yield Block(about, f"{_SPEED}\n{_TRAVEL}")
        yield from rest
        inertia = self._slot(layout.INERTIA)
        yield Block(f"The whole [{torque}].", f"torque = {inertia} * acceleration + friction + outside")

    def _after_travel(self) -> Iterator[Block]:
        torque, place = self._model.torque_symbol, named("place")
        # what multiplies the level multiplies what the elements carry, too
        carried = tuple(self._from_kernels("level_factor", "factor = factor * {}", None, None, place))
        if carried:
            yield Block("What all dry friction is multiplied by.", "factor = 1.0")
            yield from carried
        yield from self._bristle(bool(carried))
        yield Block(f"Viscous friction [{torque}].", f"coefficient = {self._slot(layout.VISCOUS)}")
        yield from self._from_kernels("viscous", "coefficient = coefficient + {}", None, named("speed"))
        yield from self._from_kernels("viscous_factor", "coefficient = coefficient * {}", None, None)
        yield Block(f"All friction [{torque}].", "friction = friction + coefficient * speed")
        yield from self._elements(bool(carried))
        yield Block("What is not friction.", f"outside = {self._slot(layout.OFFSET)}")
        yield from self._from_kernels("torque", "outside = outside + {}", None, place)

    def _bristle(self, factored: bool) -> Iterator[Block]:
        """The contact up to the middle of the sample, and its friction there."""
        motion, torque = self._model.motion_unit, self._model.torque_symbol
        self._note("LEAST_LEVEL", LEAST_SHARE * self._model["coulomb"], torque, "friction never falls below")
        self._note("LEAST_DEFLECTION", LEAST_DEFLECTION, motion, "its limit never falls below")
        self._note("LEAST_SLIP", LEAST_SLIP, "1", "less than this of the limit in a sample is no motion")
        yield from self._level("velocity", factored)
        yield Block("The contact bends with the motion and slides at its limit.", self._moved())
        if self._level_changes():
            yield from self._level("speed", factored)
        damping = self._slot(layout.MICRO_DAMPING)
        if self._p[layout.DAMPING_VELOCITY] > 0.0:
            at, tail = (self._constant(slot) for slot in (layout.DAMPING_VELOCITY, layout.DAMPING_TAIL))
            square = Term(ast.Constant(2.0), 2.0)
            statements = self._written(fallen, "part = {}", named("speed"), at, square, tail)
            yield Block("Part of the damping in presliding that is left at this speed.", statements)
            damping = f"part * {damping}"
        yield Block(f"What the bent contact holds back [{torque}].", self._held(damping))

    def _level_changes(self) -> bool:
        """Whether the contact slides at another limit where the speed is another one."""
        by_effects = any(
            self._on[at] and kind.kernels.level is not None for at, kind in enumerate(EFFECTS.values())
        )
        return bool(self._on[FALLS]) or by_effects or bool(self._p[layout.CREEP_VELOCITY] > 0.0)

    def _level(self, speed: str, factored: bool) -> Iterator[Block]:
        """The level of friction at a speed, and the limit that it gives the contact."""
        torque, fast = self._model.torque_symbol, named(speed)
        yield Block(f"Level of friction at the {speed} [{torque}].", f"level = {self._slot(layout.COULOMB)}")
        if self._on[FALLS]:
            least, most = self._slot(layout.COULOMB), self._slot(layout.BREAK_AWAY)
            terms = (self._constant(slot) for slot in (layout.STRIBECK_VELOCITY, EXPONENT, TAIL))
            use = f"level = {least} + ({most} - {least}) * {{}}"
            yield self._from_kernel(FALLS, fallen, use, fast, *terms)
        yield from self._from_kernels("level", "level = level + {}", None, None, fast)
        if self._carries():
            yield self._from_kernel(REMEMBERS, more_to_carry, "more = {}", None, named("level"))
            yield Block("What the bristle has of it.", f"level = {self._slot(layout.COULOMB)} * more")
        if factored:
            yield Block(f"Level of friction there [{torque}].", "level = level * factor")
        yield Block(f"Where the contact slides [{self._model.motion_unit}].", self._limit(fast))

    def _carries(self) -> bool:
        """Whether the elements share what is added to the level."""
        return bool(self._on[REMEMBERS]) and bool(self._p[ATTRACTION] > 0.0)

    def _elements(self, factored: bool) -> Iterator[Block]:
        """What the hysteresis elements hold back."""
        if not self._on[REMEMBERS]:
            return
        travel, more = named("travel"), named("more") if self._carries() else Term(ast.Constant(1.0), 1.0)
        at = Term(ast.Constant(ELEMENT_STATES), ELEMENT_STATES)
        if self._p[DAMPING] > 0.0:  # asked before the elements move
            faded = "part * " if self._p[layout.DAMPING_VELOCITY] > 0.0 else ""
            damped = f"friction = friction + {faded}{{}} * speed"
            yield self._from_kernel(REMEMBERS, memory_damping, damped, None, None, at, travel, more)
        use = "friction = friction + factor * {}" if factored else "friction = friction + {}"
        yield self._from_kernel(REMEMBERS, memory_torque, use, None, None, at, travel, more, named("PERIOD"))

    def _limit(self, speed: Term) -> str:
        """Where the contact slides; without static friction that comes to nothing with speed."""
        stiffness = self._slot(layout.STIFFNESS)
        limit = f"limit = max(max(level, LEAST_LEVEL) / {stiffness}, LEAST_DEFLECTION)"
        if self._p[layout.CREEP_VELOCITY] == 0.0:
            return limit
        course = (self._constant(slot) for slot in (layout.CREEP_VELOCITY, layout.CREEP_TAIL))
        return f"{limit}\n{self._written(crept, 'limit = limit * {}', speed, *course)}"

    def _moved(self) -> str:
        """The contact bent on by the travel of a sample."""
        if self._p[layout.BENDS_BACK] > 0.0:
            return self._bent()
        return (
            "slip = abs(travel) / limit\n"
            "if slip >= LEAST_SLIP:\n"
            "    steady = limit\n"
            "    if velocity < 0.0:\n"
            "        steady = -limit\n"
            "    bristle = steady + (bristle - steady) * exp(-slip)"
        )

    def _bent(self) -> str:
        """The same by a curve of its own."""
        ratio, slip, half, part = (named(name) for name in ("ratio", "slip", "half", "part_bent"))
        curve = self._curve()
        steps = (
            self._written(bends, "part_bent = {}", ratio, *curve),
            self._written(halfway, "half = {}", ratio, slip, part),
            self._written(bends, "part_bent = {}", half, *curve),
            self._written(onward, "ratio = {}", ratio, slip, half, part, curve[-1]),
        )
        on = "\n".join(steps)
        return (
            "slip = abs(travel) / limit\n"
            f"{_side_of('velocity')}"
            "if slip >= LEAST_SLIP:\n"
            f"{textwrap.indent(on, '    ')}\n"
            "    bristle = side * ratio * limit"
        )

    def _held(self, damping: str) -> str:
        """The friction of the bent contact, with what damps it at this speed."""
        held = f"friction = {self._slot(layout.STIFFNESS)} * bristle + {damping} * rate"
        if self._p[layout.BENDS_BACK] > 0.0:
            rate = self._written(bends, "rate = {}", named("ratio"), *self._curve())
            return f"{_side_of('speed')}{rate}\n{held} * speed"
        return f"rate = speed - abs(speed) / limit * bristle\n{held}"

    def _curve(self) -> list[Term]:
        slots = (layout.BENDS_BACK, layout.BENDS_35, layout.BENDS_65, layout.BENDS_85)
        return [self._constant(slot) for slot in slots]

    def _from_kernels(self, quantity: str, use: str, *arguments: Term | None) -> Iterator[Block]:
        """A block for each effect that contributes to a quantity (a field of `models.effect.Kernels`)."""
        for at, kind in enumerate(EFFECTS.values()):
            kernel: Callable[..., Any] | None = getattr(kind.kernels, quantity)
            if self._on[at] and kernel is not None:
                yield self._from_kernel(at, kernel, use, *arguments)

    def _from_kernel(
        self, effect: int, kernel: Callable[..., Any], use: str, *arguments: Term | None
    ) -> Block:
        return Block(f"{layout.EFFECT_NAMES[effect]}.", self._written(kernel, use, *arguments))

    def _written(self, kernel: Callable[..., Any], use: str, *arguments: Term | None) -> str:
        """A kernel's statements, and what its result is used for."""
        statements, result = Writer(self._constant, self._state).call(kernel, *arguments)
        target, _, formula = use.partition(" = ")
        tree = ast.parse(formula.format(f"({result})"), mode="eval")
        return f"{statements}\n{target} = {ast.unparse(tree)}".strip()

    def _slot(self, slot: int) -> str:
        return ast.unparse(self._constant(slot).node)

    def _constant(self, slot: int) -> Term:
        """The constant for a place in the vector of parameters."""
        name, unit, meaning = self._places[slot]
        value = float(self._p[slot])
        self._note(name, value, unit, meaning)
        return named(name, value)

    def _state(self, slot: int) -> str:
        """The name for a place in the vector of states."""
        effect, place = divmod(slot - layout.BASE_STATES, layout.STATE_BLOCK)
        owner = layout.EFFECT_NAMES[effect]
        name = f"{owner}_{place + 1}"
        self._states[name] = State(name, f"what {owner} remembers")
        return name

    def _note(self, name: str, value: float, unit: str, meaning: str) -> None:
        self._constants[name] = Constant(name, value, unit, meaning)


def _places(model: DriveModel) -> dict[int, tuple[str, str, str]]:
    """Name, unit and meaning by place in the vector of parameters."""
    motion = model.motion_unit
    found = {scale_slot(): (_SCALE, f"rad/{motion}", "angle of one cycle per turn or metre")}
    owned: list[tuple[Kind | None, Any]] = [(None, parameter) for parameter in WHOLE_BASE]
    owned += [(kind, parameter) for kind in EFFECTS.values() for parameter in kind.parameters]
    for kind, parameter in owned:
        name = parameter.name if kind is None else kind.surface(parameter.name)
        unit = parameter.unit_for(motion, model.torque_unit)
        found[parameter.slot] = (name.replace(".", "_").upper(), unit, parameter.meaning)
    return found


def _side_of(speed: str) -> str:
    """Statements for the direction of a speed, and how far the contact is bent that way."""
    return f"side = 1.0\nif {speed} < 0.0:\n    side = -1.0\nratio = side * bristle / limit\n"


def _names(statements: str) -> set[str]:
    return {node.id for node in ast.walk(ast.parse(statements)) if isinstance(node, ast.Name)}
