"""Refinement of a model's feedforward on measured periods of the benchmark.

The period-averaged error with the feedforward in force is compared with that of a simulation: the model
itself in the drive's closed loop, without noise and quantiser. The few parameters that this motion excites
are moved so that both agree,

    min |e_measured − e(p)|²/σ² + |(p − p₀)/s|²,

by Gauss–Newton with finite differences; σ is the noise of the average, and s (`_width`) how far a value may
be from the diagnosed one. What the model cannot explain stays in the prediction as it was measured:

    e_predicted = e_measured − e(p | u_ff) + e(p | u_ff(p)).

The offset takes the mean of u_PID, as in `refinement`. Inertia, viscous friction, and where elements slide
or ripple repeats, stay as identified: one slow sine says next to nothing about them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from autotune.control.model_feedforward import periodic_model_feedforward
from autotune.control.refinement import PeriodAverage, smooth_peak
from autotune.core.arrays import Floats
from autotune.models import layout
from autotune.models.drive_model import DriveModel, surface_parameter
from autotune.models.plant import simulate, substeps_for
from autotune.models.total_friction import total_friction
from autotune.recordings.recording import Controller

PERIODS = 4
ITERATIONS = 6
DIFFERENCE = 0.02
STOP = 1e-3
MOVED = ("coulomb", "stiffness", "micro_damping")
Misfit = Callable[[Floats], Floats | None]


@dataclass(frozen=True, slots=True)
class ModelRefinement:
    """A proposed model, and the peak and smooth peak of the error that it should give [motion unit]."""

    model: DriveModel
    predicted_peak: float
    predicted_smooth_peak: float


def simulated_error(
    model: DriveModel, controller: Controller, measured: PeriodAverage, feedforward: Floats, limit: float
) -> Floats | None:
    """Error of the model's steady cycle under a feedforward, shape (n,); None where it is not stable."""
    packed, reference, period = model.pack(), measured.reference, measured.period
    state = np.zeros(layout.STATES)
    state[layout.POSITION] = reference[0]
    state[layout.VELOCITY] = (reference[1] - reference[-1]) / (2.0 * period)
    loop = np.array([period, limit, 0.0, 0.0, 0.0, reference[-1], reference[-1]])
    gains = np.array([controller.kp, controller.kd, controller.ki, controller.derivative_filter])
    command, offset = np.tile(reference, PERIODS), np.tile(feedforward, PERIODS)
    nothing, position, torque = np.zeros(len(command)), np.empty(len(command)), np.empty(len(command))
    done = simulate(
        packed.p, packed.on, state, gains, loop, True, substeps_for(packed.p, period, packed.on), command,
        offset, nothing, nothing, position, torque,
    )  # fmt: skip
    error = np.asarray(reference - position[-len(reference) :])
    if done < len(command) or not np.all(np.isfinite(error)):
        return None
    return error if float(np.max(np.abs(error))) < float(np.ptp(reference)) else None


def moved_parameters(model: DriveModel) -> tuple[str, ...]:
    """What a refinement may change, by surface name."""
    return tuple(name for name in model.parameters if name in MOVED or surface_parameter(name).refined)


def refine_model(
    measured: PeriodAverage, model: DriveModel, controller: Controller, limit: float, noise: float
) -> ModelRefinement | None:
    """Moves the model to where its simulated error agrees with the measured one.

    Args:
        measured: the averaged period with the feedforward of `model` in force.
        model: with its effects; those that are not fed forward take part in the simulation.
        controller: the drive's position controller.
        limit: of the torque [N m].
        noise: standard deviation of the averaged error [motion unit].

    Returns:
        None where the simulation is not stable on this model: nothing can be said then.
    """
    names = moved_parameters(model)
    start = np.array([model[name] for name in names])
    width = np.array([_width(name, model) for name in names])
    low = np.array([surface_parameter(name).lower for name in names])
    high = np.array([surface_parameter(name).upper for name in names])

    def at(x: Floats) -> DriveModel:
        values = np.clip(start + width * x, low, high)
        return model.with_values(dict(zip(names, values.tolist(), strict=True)))

    def misfit(x: Floats) -> Floats | None:
        error = simulated_error(at(x), controller, measured, measured.feedforward, limit)
        return None if error is None else np.concatenate([(measured.error - error) / noise, x])

    best = _least_squares(misfit, len(names))
    if best is None:
        return None
    refined = at(best)
    refined = refined.with_values({"offset": refined["offset"] + float(measured.feedback.mean())})
    with_old = simulated_error(refined, controller, measured, measured.feedforward, limit)
    torque = periodic_model_feedforward(refined, measured.reference, measured.period)
    with_new = simulated_error(refined, controller, measured, torque, limit)
    if with_old is None or with_new is None:
        return None
    error = measured.error - with_old + with_new
    return ModelRefinement(refined, float(np.max(np.abs(error))), smooth_peak(error))


def _least_squares(misfit: Misfit, size: int) -> Floats | None:
    """Gauss–Newton with damping, from 0; None where the start cannot be simulated."""
    x, damping = np.zeros(size), 1e-3
    rest = misfit(x)
    if rest is None:
        return None
    for _ in range(ITERATIONS):
        columns = _sensitivities(misfit, x, rest)
        if columns is None:
            break
        found, damping = _descent(misfit, x, rest, columns, damping)
        if found is None:
            break
        x, fallen = found
        done = float(rest @ rest - fallen @ fallen) < STOP * float(rest @ rest)
        rest = fallen
        if done:
            break
    return x


def _descent(
    misfit: Misfit, x: Floats, rest: Floats, columns: Floats, damping: float
) -> tuple[tuple[Floats, Floats] | None, float]:
    """A step that lowers the cost, with its residuals, and the damping to go on with; None for no step."""
    normal, slope = columns.T @ columns, columns.T @ rest
    for _ in range(5):
        trial = x - np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
        found = misfit(trial)
        if found is not None and float(found @ found) < float(rest @ rest):
            return (trial, found), 0.2 * damping
        damping = max(8.0 * damping, 1e-2)
    return None, damping


def _sensitivities(misfit: Misfit, x: Floats, rest: Floats) -> Floats | None:
    columns = np.empty((len(rest), len(x)))
    for i in range(len(x)):
        moved = x.copy()
        moved[i] += DIFFERENCE
        found = misfit(moved)
        if found is None:
            return None
        columns[:, i] = (found - rest) / DIFFERENCE
    return columns


def _width(name: str, model: DriveModel) -> float:
    """How far a value may be from the diagnosed one; for parameters of effects a part of all friction."""
    if name in ("coulomb", "stiffness"):
        return 0.3 * max(model[name], 1e-6)
    if name == "micro_damping":
        return max(0.5 * model[name], 5e-4 * model["stiffness"])
    return surface_parameter(name).refined * total_friction(model).value
