"""Composed machines: the same motion as a library's solver finds, and drawings that are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from autotune.core.errors import ConfigurationError
from autotune_sim.composition import machine_of, plant_of, read_machine
from autotune_sim.machine import Machine
from autotune_sim.plant import advance, fresh_state, pack
from autotune_sim.presets import preset
from autotune_sim.servo import Servo

MACHINES = Path(__file__).parents[2] / "config" / "machines"
COLUMN, CARRIAGES = MACHINES / "counterbalanced-column.toml", MACHINES / "two-carriages.toml"
H = 1e-3
Floats = NDArray[np.float64]


def derivative(machine: Machine, state: Floats, torque: float) -> Floats:
    """Newton's law and LuGre's equations, written from the machine's definition for a library's solver."""
    n = len(machine.mass)
    x, v, z = state[:n], state[n : 2 * n], state[2 * n :]
    force = np.array(machine.force)
    force[0] += torque
    rates = np.zeros(len(machine.contacts))
    for spring in machine.springs:
        c = np.array(spring.coefficients)
        force -= c * (spring.stiffness * (c @ x) + spring.damping * (c @ v))
    for k, contact in enumerate(machine.contacts):
        c = np.array(contact.coefficients)
        slip = c @ v
        rise = contact.break_away - contact.coulomb
        level = (contact.coulomb + rise * np.exp(-((slip / contact.velocity) ** 2))) / contact.stiffness
        rates[k] = slip - abs(slip) * z[k] / level
        force -= c * (contact.stiffness * z[k] + contact.damping * rates[k] + contact.viscous * slip)
    return np.concatenate([v, force / np.array(machine.mass), rates])


@pytest.mark.parametrize("path", [COLUMN, CARRIAGES], ids=lambda path: path.stem)
def test_the_motion_is_the_one_that_a_librarys_solver_finds(path: Path) -> None:
    """Rest, break-away, sliding at speed and back, by torques that change every millisecond."""
    plant = plant_of(read_machine(path), H)
    machine = plant.machine
    assert machine is not None
    cycles = 160
    level = 0.5 * plant.torque_limit
    torques = level * np.sin(2 * np.pi * np.arange(cycles) * H / 0.08)
    steps = machine.steps(H)
    packed, state = pack(plant, H / steps), fresh_state()
    ours, theirs = np.zeros(cycles), np.zeros(cycles)
    exact = np.zeros(2 * len(machine.mass) + len(machine.contacts))
    for k, torque in enumerate(torques):
        advance(packed[0], state[0], torque, 0.0, False, steps, H / steps)
        state["motor_torque"] = state["motor_half"] = torque
        solution = solve_ivp(
            lambda _, y, u=torque: derivative(machine, y, u),
            (0.0, H),
            exact,
            method="LSODA",
            rtol=1e-7,
            atol=1e-11,
        )
        exact = solution.y[:, -1]
        ours[k], theirs[k] = state["position"][0], exact[0]
    travel = np.ptp(theirs)
    assert travel > 0.05  # far beyond presliding
    # first order in the step, a quarter radian of the fastest mode
    assert np.abs(ours - theirs).max() < 0.01 * travel


def test_gears_and_levers_add_up() -> None:
    column = machine_of(read_machine(COLUMN))
    lead = 1.5915e-3
    assert column.mass[0] == pytest.approx(9e-4 + 60.0 * lead**2)
    assert column.free_inertia == pytest.approx(9e-4 + 115.0 * lead**2)
    assert column.force[0] == pytest.approx(-588.6 * lead)


def test_a_drive_behind_a_machine_follows() -> None:
    servo = Servo(preset(str(COLUMN)))
    servo.power(True)
    for k in range(600):
        state = servo.cycle(target_position=0.2 * min(k / 300, 1.0))
    assert state.position == pytest.approx(0.2, abs=2e-3)
    # standing, the motor carries what the counterweight does not, within what friction may take off
    assert abs(servo.torque) < (588.6 - 539.55 + 110.0 + 25.0) * 1.5915e-3 + 0.15


def test_two_equal_counterweights_hold_each_other() -> None:
    """Nothing moves without power, and the column comes down when the chain is taken away."""
    text = COLUMN.read_text()
    assert "between" in text
    servo = Servo(preset(str(COLUMN)))
    for _ in range(200):
        servo.idle()
    assert abs(servo.true_position) < 0.02


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ('body = "screw"', 'body = "scrw"', "did you mean 'screw'"),
        ('to = "column"', 'to = "ground"', "what does not move is no body"),
        (
            "[[forces]]",
            '[[gears]]\nfrom = "screw"\nto = "column"\nratio = 1.6e-3\n[[forces]]',
            "ring",
        ),
        ("ratio = 1.5915e-3 # m/rad", "ratio = 0.0", "would stand still"),
        ('between = ["column", "counterweight"]', 'between = ["column", "ground"]', "'counterweight'"),
        ('between = ["column", "counterweight"]', 'between = ["screw", "column"]', "'counterweight'"),
        ("stiffness = 4e6 # N/m", "stiffness = 4e14", "steps of integration"),
        ("mass = 60.0 # kg", "mass = 60.0\ninertia = 1.0", "either an inertia"),
        ("mass = 60.0 # kg", "mass = 0.0", "greater than 0"),
        ("coulomb = 25.0", "coulmb = 25.0", "did you mean 'coulomb'"),
        ("counts_per_revolution = 65536", "", "counts_per_revolution or counts_per_metre"),
    ],
)
def test_drawings_that_are_none(before: str, after: str, told: str, tmp_path: Path) -> None:
    text = COLUMN.read_text()
    assert before in text
    path = tmp_path / "machine.toml"
    path.write_text(text.replace(before, after, 1))
    with pytest.raises(ConfigurationError, match=told):
        plant_of(read_machine(path), H)


def test_a_spring_within_one_rigid_group_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    spring = '\n[[springs]]\nbetween = ["screw", "column"]\nratio = 1.5915e-3\nstiffness = 1e6\n'
    path.write_text(COLUMN.read_text() + spring)
    with pytest.raises(ConfigurationError, match="never moves"):
        plant_of(read_machine(path), H)


def test_effects_are_drawn_not_planted() -> None:
    with pytest.raises(ConfigurationError, match="draw it into the file"):
        preset(str(COLUMN), effects={"stribeck": 0.1})
