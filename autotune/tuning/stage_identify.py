"""Stages `experiment` and `fit`: the four experiments of section 3.4, and what they say."""

from __future__ import annotations

import math
from dataclasses import dataclass

from autotune.control.feedforward import LugreParameters
from autotune.core.errors import ConfigurationError, NotEnoughExcitation
from autotune.experiments.programmes import build
from autotune.experiments.sines import BenchmarkSine
from autotune.identify.estimate import Estimate
from autotune.identify.run import Identification, identify_run
from autotune.models.model_file import write_model
from autotune.recordings.recording import Recording
from autotune.tuning.proof import TrackingError, tracking_error
from autotune.tuning.session import Session
from autotune.tuning.stage_adapt import starting_stiffness
from autotune.tuning.unfit_axes import refuse_what_cannot_be_tuned

BASELINE_PERIODS = 3


@dataclass(frozen=True, slots=True)
class AdaptationStart:
    """Where adaptation begins: identified values, and bounds of the stiffness."""

    parameters: LugreParameters
    stiffness_range: tuple[float, float]


def baseline(session: Session) -> TrackingError:
    """The benchmark once, as the axis is now: it shows early that loop and limits are sound.

    Raises:
        NotTunable: the loop oscillates, the error does not repeat, or the load changes.
    """
    sine, axis = BenchmarkSine(session.motion, 1, BASELINE_PERIODS), session.axis
    recording, _ = session.play("baseline", [sine])
    window = recording.select(sine.label)
    refuse_what_cannot_be_tuned(
        [window], axis.benchmark.frequency, axis.position_resolution, axis.motion_unit
    )
    return tracking_error([window], axis.benchmark.frequency)


def experiment(session: Session) -> Recording:
    """Plays the four experiments."""
    experiments = build("identification", session.axis)
    session.begin("experiment", sum(one.duration for one in experiments))
    recording, _ = session.play("experiment", experiments)
    return recording


def fit(session: Session, recording: Recording) -> Identification:
    """Identifies the axis; the model is in `model.toml` where it is valid.

    Raises:
        NotEnoughExcitation: the experiments do not give a model; says which and why.
    """
    session.begin("fit", 5.0)
    benchmark = session.axis.benchmark
    acceleration = benchmark.amplitude * (2.0 * math.pi * benchmark.frequency) ** 2
    found = identify_run(recording, precision=session.axis.position_resolution, acceleration=acceleration)
    if found.model is None:
        raise NotEnoughExcitation(_why(found))
    write_model(found.model, session.directory / "model.toml")
    return found


def start_of(found: Identification) -> AdaptationStart:
    """The identified values as feedforward parameters; σ1 is what the softest known contact has, in proportion.

    Raises:
        NotEnoughExcitation: a value that the feedforward needs is missing or impossible.
    """
    joint = found.joint
    known = [_stiffness(found.estimates.get(name)) for name in ("presliding", "dahl")]
    stiffness, bounds = starting_stiffness(*known)
    coulomb = joint.value("coulomb")
    # without a Stribeck velocity a level at rest of its own says nothing
    break_away = joint.value("break_away", coulomb) if "stribeck_velocity" in joint else coulomb
    # Dahl's curve is softer than the contact at rest; its relative damping, σ1/(2·√(σ0·J)), is that of the contact.
    # The laws keep σ1/σ0 on their way down to about there, so that the ratio has to be right where they end
    softest = min(value for value in known if value > 0.0)
    damping = math.sqrt(softest / joint.value("stiffness", softest)) * stiffness / softest
    try:
        parameters = LugreParameters(
            inertia=joint.value("inertia"),
            viscous=joint.value("viscous", 0.0),
            coulomb=coulomb,
            stiffness=stiffness,
            micro_damping=joint.value("micro_damping", 0.0) * damping,
            offset=joint.value("offset", 0.0),
            break_away=break_away,
            stribeck_velocity=joint.value("stribeck_velocity", 1.0),
        )
    except ConfigurationError as error:
        raise NotEnoughExcitation(f"the identified values cannot be used: {error}") from error
    return AdaptationStart(parameters, bounds)


def _stiffness(estimate: Estimate | None) -> float:
    return estimate.value("stiffness") if estimate is not None and "stiffness" in estimate else math.nan


def _why(found: Identification) -> str:
    reasons = [
        f"{name}: {estimate.reason}" for name, estimate in found.estimates.items() if not estimate.valid
    ]
    return f"the axis could not be identified ({found.joint.reason}). " + "; ".join(reasons)
