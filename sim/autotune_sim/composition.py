"""A machine drawn by a user: bodies, gears, springs, friction and forces in a TOML file, made into a plant.

    schema = 1
    name = "counterbalanced-column"
    [motor]                  # on which body torque acts and, unless `encoder` names another, which is measured
    body = "screw"
    torque_limit = 2.0       # N m (N on a linear motor)
    counts_per_revolution = 50000        # or counts_per_metre
    [bodies.screw]
    inertia = 8e-4           # kg m²; a body that moves along a line has a `mass` [kg]
    [bodies.column]
    mass = 60.0
    [[gears]]                # rigid: `to` moves by ratio × the motion of `from`
    from = "screw"
    to = "column"
    ratio = 1.6e-3           # m/rad
    [[springs]]              # elongation = motion of the second − ratio × motion of the first
    between = ["column", "counterweight"]
    ratio = -1.0
    stiffness = 4e6
    damping = 2e3
    [[friction]]
    between = ["column", "ground"]
    coulomb = 40.0
    stiffness = 2e7
    [[forces]]
    on = "column"
    force = -588.6           # N

The thesis (Appendix A) draws such machines as bond graphs: rigid bodies are serial, interfaces parallel junctions.
Here, too, every interface's force follows from velocities and its own state, so that ordinary differential
equations are left; what would need more (rings of gears, bodies that hang on nothing) is refused in words.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from autotune.core.configuration import Strict, read_toml, validate
from autotune.core.errors import ConfigurationError
from autotune_sim.machine import (
    MAX_BODIES,
    MAX_CONTACTS,
    MAX_SPRINGS,
    MOST_STEPS,
    Amplifier,
    Contact,
    Machine,
    Spring,
)
from autotune_sim.plant import PlantParameters, Wave

GROUND = "ground"
Positive = Annotated[float, Field(gt=0.0, lt=1e15)]
NotNegative = Annotated[float, Field(ge=0.0, lt=1e15)]
Ratio = Annotated[float, Field(gt=-1e6, lt=1e6)]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,40}$")]


class _Motor(Strict):
    body: str
    encoder: str | None = None
    torque_limit: Positive
    counts_per_revolution: Annotated[int, Field(ge=100, le=2**31)] | None = None
    counts_per_metre: Annotated[float, Field(ge=100, le=1e12)] | None = None
    process_noise: NotNegative = 0.0
    torque_noise: NotNegative = 0.0

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        if (self.counts_per_revolution is None) == (self.counts_per_metre is None):
            raise ValueError("give either counts_per_revolution or counts_per_metre")
        return self


class _Body(Strict):
    inertia: Positive | None = None
    mass: Positive | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.inertia is None) == (self.mass is None):
            raise ValueError("a body needs either an inertia (it turns) or a mass (it moves along a line)")
        return self


class _Gear(Strict):
    from_: str = Field(alias="from")
    to: str
    ratio: Ratio


class _Between(Strict):
    between: tuple[str, str]
    ratio: Ratio = 1.0


class _Spring(_Between):
    stiffness: Positive
    damping: NotNegative = 0.0
    gap: NotNegative = 0.0


class _Damper(_Between):
    damping: Positive


class _Friction(_Between):
    coulomb: NotNegative
    break_away: Positive | None = None
    stribeck_velocity: Positive = 0.1
    stiffness: Positive
    micro_damping: NotNegative = 0.0
    viscous: NotNegative = 0.0


class _Force(Strict):
    on: str
    force: float


class _Ripple(Strict):
    order: Positive
    amplitude: NotNegative
    phase: float = 0.0


class _Amplifier(Strict):
    gain: Positive
    resistance: Positive
    capacitance: Positive
    current: Positive
    coupling: Positive


class _Controller(Strict):
    kp: Positive
    kd: NotNegative = 0.0
    ki: NotNegative = 0.0
    derivative_filter: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0


class MachineFile(Strict):
    """A machine's TOML file."""

    schema_: Literal[1] = Field(alias="schema")
    name: Name
    motor: _Motor
    bodies: dict[Name, _Body] = Field(min_length=1, max_length=40)
    gears: list[_Gear] = Field(default_factory=list, max_length=40)
    springs: list[_Spring] = Field(default_factory=list, max_length=MAX_SPRINGS)
    dampers: list[_Damper] = Field(default_factory=list, max_length=MAX_SPRINGS)
    friction: list[_Friction] = Field(default_factory=list, max_length=MAX_CONTACTS)
    forces: list[_Force] = Field(default_factory=list, max_length=40)
    ripple: list[_Ripple] = Field(default_factory=list, max_length=8)
    amplifier: _Amplifier | None = None
    controller: _Controller | None = None


def read_machine(path: str | Path) -> MachineFile:
    """Reads a machine's file; `plant_of` makes the plant.

    Raises:
        ConfigurationError: no such file, unknown keys, or values out of range.
    """
    return validate(MachineFile, read_toml(path, "machine file"), str(path))


def plant_of(file: MachineFile, period: float) -> PlantParameters:
    """The plant that a machine's file draws.

    Raises:
        ConfigurationError: a body that is not there, is held twice, or hangs on nothing; a ring of gears; a spring
            that cannot stretch; more than the simulation can hold, or stiffer than it can follow.
    """
    machine = machine_of(file)
    steps = machine.steps(period)
    if steps > MOST_STEPS:
        raise ConfigurationError(
            f"machine {file.name}: its fastest mode needs {steps} steps of integration a cycle, allowed are "
            f"{MOST_STEPS}; take the stiffest spring, or the lightest body, for rigid: use a gear"
        )
    motor = file.motor
    counts = motor.counts_per_revolution or round(2.0 * math.pi * (motor.counts_per_metre or 0.0))
    return PlantParameters(
        inertia=machine.free_inertia,
        viscous=0.0,
        offset=0.0,
        counts=counts,
        torque_limit=motor.torque_limit,
        process_noise=motor.process_noise,
        torque_noise=motor.torque_noise,
        ripple=tuple(Wave(wave.order, wave.amplitude, wave.phase) for wave in file.ripple),
        machine=machine,
    )


def machine_of(file: MachineFile) -> Machine:
    """Bodies that gears couple become one coordinate; springs and contacts act between coordinates."""
    for name in _named(file):
        _known(file, name)
    rigid = _rigid_groups(file)
    _refuse_free(file, rigid)
    roots = list(dict.fromkeys(root for root, _ in rigid.values()))
    order = [rigid[file.motor.body][0], *(r for r in roots if r != rigid[file.motor.body][0])]
    if len(order) > MAX_BODIES:
        raise ConfigurationError(
            f"machine {file.name}: {len(order)} bodies move independently, allowed are {MAX_BODIES}; "
            "couple some by gears"
        )
    scale = rigid[file.motor.body][1]  # so that coordinate 0 is the motor's own motion
    row = {name: _row(order, root, ratio, scale) for name, (root, ratio) in rigid.items()}
    row[GROUND] = np.zeros(len(order))
    mass, force = np.zeros(len(order)), np.zeros(len(order))
    for name, body in file.bodies.items():
        mass += row[name] ** 2 * float(body.mass or body.inertia or 0.0)
    for push in file.forces:
        force += row[push.on] * push.force
    return Machine(
        mass=tuple(mass.tolist()),
        force=tuple(force.tolist()),
        springs=tuple(_springs(file, row)),
        contacts=tuple(_contacts(file, row)),
        sensed=tuple(row[file.motor.encoder or file.motor.body].tolist()),
        amplifier=None if file.amplifier is None else Amplifier(**file.amplifier.model_dump()),
    )


def _named(file: MachineFile) -> Iterator[str]:
    """Every body that something refers to; a fixed end may be the ground."""
    yield file.motor.body
    if file.motor.encoder is not None:
        yield file.motor.encoder
    for gear in file.gears:
        yield from (gear.from_, gear.to)
    for part in (*file.springs, *file.dampers, *file.friction):
        ends = [end for end in part.between if end != GROUND]
        if not ends:
            raise ConfigurationError(
                f"machine {file.name}: a spring or contact lies between ground and ground"
            )
        yield from ends
    for push in file.forces:
        yield push.on


def _known(file: MachineFile, name: str) -> None:
    if name in file.bodies:
        return
    near = difflib.get_close_matches(name, file.bodies, 1)
    hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(file.bodies)}"
    if name == GROUND:
        hint = (
            "what a gear holds to the ground does not move, and what does not move is no body: leave it out"
        )
    raise ConfigurationError(f"machine {file.name}: there is no body {name!r}; {hint}")


def _rigid_groups(file: MachineFile) -> dict[str, tuple[str, float]]:
    """Body → (the group's first body, its motion for each unit of that one's)."""
    group = {name: (name, 1.0) for name in file.bodies}
    for gear in file.gears:
        (one, r1), (two, r2) = group[gear.from_], group[gear.to]
        if gear.ratio == 0.0:
            raise ConfigurationError(
                f"machine {file.name}: the gear from {gear.from_!r} to {gear.to!r} has ratio 0: {gear.to!r} would "
                "stand still"
            )
        if one == two:
            raise ConfigurationError(
                f"machine {file.name}: gears close a ring through {gear.from_!r} and {gear.to!r} (an algebraic loop); "
                "replace one of them by a stiff spring, as it is in a real machine"
            )
        factor = gear.ratio * r1 / r2  # motion of group two's first body for that of group one's
        for name, (root, ratio) in group.items():
            if root == two:
                group[name] = (one, ratio * factor)
    return group


def _refuse_free(file: MachineFile, rigid: dict[str, tuple[str, float]]) -> None:
    """Every body must hang, through gears, springs or friction, on what the motor moves."""
    reached = {rigid[file.motor.body][0]}
    parts = [
        part.between for part in (*file.springs, *file.dampers, *file.friction) if GROUND not in part.between
    ]
    for _ in file.bodies:
        for a, b in parts:
            ends = {rigid[a][0], rigid[b][0]}
            if ends & reached:
                reached |= ends
    free = [name for name, (root, _) in rigid.items() if root not in reached]
    if free:
        raise ConfigurationError(
            f"machine {file.name}: {', '.join(map(repr, free))} {'hangs' if len(free) == 1 else 'hang'} on nothing "
            "that the motor moves; connect it by a gear, a spring or friction, or leave it out"
        )


def _row(
    order: list[str], root: str, ratio: float, scale: float
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    row = np.zeros(len(order))
    index = order.index(root)
    row[index] = ratio / scale if index == 0 else ratio
    return row


Rows = dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]


def _relative(file: MachineFile, row: Rows, part: _Between) -> tuple[float, ...]:
    first, second = part.between
    relative = row[second] - part.ratio * row[first]
    if not np.any(np.abs(relative) > 1e-12):
        raise ConfigurationError(
            f"machine {file.name}: what lies between {first!r} and {second!r} never moves: gears make both ends move "
            "together; leave it out or take a gear away"
        )
    return tuple(relative.tolist())


def _springs(file: MachineFile, row: Rows) -> Iterator[Spring]:
    for spring in file.springs:
        yield Spring(_relative(file, row, spring), spring.stiffness, spring.damping, spring.gap)
    for damper in file.dampers:
        yield Spring(_relative(file, row, damper), 0.0, damper.damping)


def _contacts(file: MachineFile, row: Rows) -> Iterator[Contact]:
    for one in file.friction:
        yield Contact(
            coefficients=_relative(file, row, one),
            coulomb=one.coulomb,
            break_away=one.break_away or one.coulomb,
            velocity=one.stribeck_velocity,
            stiffness=one.stiffness,
            damping=one.micro_damping,
            viscous=one.viscous,
        )
