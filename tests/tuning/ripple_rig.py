"""Torque ripple aligned, committed and judged by the plant, on both simulated drives; no host on the wire after it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from autotune.experiments.runner import Budget
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.table import EFFECTS
from autotune.tuning.commit import commit, feedforward_parameters
from autotune.tuning.journal import Journal
from autotune.tuning.preparation import own_feedforward
from autotune.tuning.progress import Silent
from autotune.tuning.session import Session
from autotune.tuning.stage_ripple import RipplePlan, plan_ripple, removed
from autotune_sim.own_ripple import own_ripple
from autotune_sim.plant import Wave
from autotune_sim.presets import Preset, preset
from autotune_sim.servo import Servo
from tests.tuning.cut_rig import NOW
from tests.tuning.ripple_cut_rig import HarmonicsRig, TableRig

TURN = 2.0 * np.pi
SPEED = 3.0  # rad/s at which speed ripple is judged
TURNS = 20  # over which: in two, the noise of the axis at these orders is a tenth of the ripple
RIGS: Mapping[str, type[HarmonicsRig] | type[TableRig]] = {"harmonics": HarmonicsRig, "table": TableRig}


def planted(seed: int, orders: tuple[float, ...] = (12.0, 24.0)) -> Preset:
    """The vertical axis, varied, with ripple of these orders: 8 to 25 mN m each, any phase."""
    random = np.random.default_rng([seed, 9])
    waves = tuple(
        Wave(order, float(random.uniform(8e-3, 25e-3)), float(random.uniform(0.0, TURN))) for order in orders
    )
    axis = preset("edm-vertical", seed)
    return replace(axis, plant=replace(axis.plant, ripple=waves))


def model_of(axis: Preset, amplitude: float = 1.05, phase: float = 0.05) -> DriveModel:
    """What a diagnosis would have found of it: a little beside the truth."""
    values = {"inertia": axis.plant.inertia, "viscous": axis.plant.viscous, "coulomb": 0.3, "stiffness": 100.0,
              "micro_damping": 0.1, "offset": axis.plant.offset}  # fmt: skip
    lines: dict[str, float] = {}
    for number, wave in enumerate(axis.plant.ripple, 1):
        size, angle = amplitude * wave.amplitude, wave.phase + phase
        lines |= {f"order_{number}": wave.order, f"sin_{number}": size * np.cos(angle),
                  f"cos_{number}": size * np.sin(angle)}  # fmt: skip
    return base_model(values).with_effect(EFFECTS["torque_ripple"].make(lines))


@dataclass(frozen=True)
class Judged:
    """What was found, and what the plant says of it.

    Attributes:
        torque: share of the ripple torque over one turn that is gone, with what the drive adds after a reset.
        speed: share of the speed ripple at the planted orders that is gone, at constant speed without a host.
        same: the drive holds after the reset what it held before.
    """

    plan: RipplePlan | str
    torque: float = 0.0
    speed: float = 0.0
    same: bool = False
    share: float = 0.0


def judged(kind: str, axis: Preset, model: DriveModel, folder: Path) -> Judged:
    """Aligns, commits, takes the drive's power, and judges what is stored."""
    rig = TableRig({}, axis, 1024) if kind == "table" else HarmonicsRig({}, axis)
    with rig.time():
        before = _speed_ripple(axis, rig.device.firmware.servo.ripple)
        session, close = _session(rig, folder)
        held = feedforward_parameters(session.loop)
        off = own_feedforward(held)
        session.journal.note(changed=off, during=dict.fromkeys(off, 0.0))
        session.loop.write_parameters(dict.fromkeys(off, 0.0))
        plan = plan_ripple(session, model, held)
        if isinstance(plan, str):
            close()
            return Judged(plan)
        assert commit(session.loop, plan.values, session.journal, folder, NOW, lambda: True)
        share = removed(session, plan)
        kept = feedforward_parameters(session.loop)
        close()
        rig.device.power_loss()
        rig.rest(1.0)
        rig.plug()
        loop = rig.open(folder / "sessions")
        same = feedforward_parameters(loop) == kept
        loop.close()
        return Judged(
            plan,
            _torque_gone(rig, axis),
            1.0 - _speed_ripple(axis, rig.device.firmware.servo.ripple) / before,
            same,
            share,
        )


def _session(rig: HarmonicsRig | TableRig, folder: Path) -> tuple[Session, Callable[[], None]]:
    directory = folder / "20261120-040000-axis"
    (directory / "recordings").mkdir(parents=True)
    axis = rig.axis()
    loop = rig.open(folder / "sessions")
    journal = Journal.begin(directory, "axis", "f00", NOW)
    session = Session(axis, loop, axis.limits, None, dict(loop.identity), folder, directory, journal, Silent(),
                      lambda: NOW, Budget(400.0))  # fmt: skip
    return session, loop.close


def _torque_gone(rig: HarmonicsRig | TableRig, axis: Preset) -> float:
    """Of the torque over one turn: the plant's ripple, and what is left of it with what the drive adds."""
    place = np.linspace(0.0, TURN, 20_000, endpoint=False)
    ripple = sum(wave.amplitude * np.sin(wave.order * place + wave.phase) for wave in axis.plant.ripple)
    record = rig.device.firmware.servo.ripple
    added = np.array([own_ripple(record[0], float(angle)) for angle in place])
    return float(1.0 - np.std(ripple - added) / np.std(ripple))


def _speed_ripple(axis: Preset, record: np.ndarray) -> float:
    """Rms of the shaft's true velocity at the planted orders over `TURNS` at constant speed [rad/s].

    On an axis of its own, as it goes far, with what the drive holds (`record`).
    """
    servo = Servo(axis, 5)
    servo.ripple[:] = record
    period, count = servo.period, round(TURNS * TURN / SPEED / servo.period)
    servo.power(True)
    start = servo.position
    rows = []
    for k in range(count + 600):
        servo.cycle(start + SPEED * period * (k + 1) * min(1.0, (k + 1) / 500))
        rows.append((servo.true_position, servo.true_velocity))
    place, speed = np.array(rows[-count:]).T
    waves = [part(wave.order * place) for wave in axis.plant.ripple for part in (np.cos, np.sin)]
    columns = np.stack([np.ones(len(place)), *waves], axis=1)
    found = np.linalg.lstsq(columns, speed, rcond=None)[0][1:]
    return float(np.sqrt(0.5 * np.sum(found**2)))
