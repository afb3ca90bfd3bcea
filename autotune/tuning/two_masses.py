"""An axis whose load does not go with its motor: told by two inertias that have to agree, and do not.

Small motion about a relaxed junction shows the inertia at the motor by its own resonance on the friction's spring,
far above the position loop's bandwidth; the motion as a whole shows it below. One mass shows the same in both. Where
a soft transmission resonates about the bandwidth, or play lets go of the load, the torque rings there, and the fit
of one mass to the whole motion has to give inertia away. What would be learned then is the motor without its load:
the motor's error falls, and the load's stays as it is (simulated axes, docs/benchmarks.md). A transmission that the
diagnosis has named is in the model, and no reason to refuse, unless its resonance lies about the bandwidth.

The response at high speed shows the same without any fit: the motor stands where its load resonates
(`antiresonance`). On 16 simulated axes with a resonance at 0.7 to 1.4 times the bandwidth that lies at 0.42 to 0.79
times the bandwidth of the motor alone, with a transmission that may be tuned (0.018 rad/N m and stiffer) at 1.13 and
more, and axes of one mass have none.
"""

from __future__ import annotations

import math
from collections.abc import Collection

from autotune.core.errors import NotEnoughExcitation
from autotune.identify.estimate import Estimate, Quantity
from autotune.identify.high_speed import antiresonance
from autotune.models.backlash import BACKLASH
from autotune.models.drive_model import DriveModel
from autotune.models.elastic_transmission import ELASTIC_TRANSMISSION
from autotune.models.torque_lag import TORQUE_LAG
from autotune.recordings.recording import Recording
from autotune.tuning.unfit_axes import NotTunable

AGREES = 0.8
"""Inertia of the whole motion over that of small motion, from which on it may be one mass."""
RESONANT = 1.6
"""Resonance of motor against load over the position loop's bandwidth, √(kp/J), from which on it may be tuned."""
ERRORS = 4.0  # standard errors by which it has to be smaller beside
NAMED = frozenset(kind.name for kind in (ELASTIC_TRANSMISSION, BACKLASH, TORQUE_LAG))
"""Effects that explain it: two masses in the model, and a lag, which looks like inertia in small motion."""


def refuse_two_masses(
    joint: Estimate, fast: Estimate | None, small: Estimate | None, named: Collection[str], kp: float | None
) -> None:
    """Looks at the inertias that were identified.

    Args:
        joint: from the motion as a whole; fast: from acceleration alone, where it says the same: a fit of everything
            can end in a false minimum, two fits do not end in the same one.
        small: from presliding, None where it was not played.
        named: effects that the diagnosis has put into the model.
        kp: of the position loop, N m/rad or N/m, for its bandwidth; None if unknown.

    Raises:
        NotTunable: they are not those of one mass.
    """
    if small is None or not small.valid or not NAMED.isdisjoint(named):
        return
    if "inertia" not in joint or "inertia" not in small:
        return
    whole, motor = joint["inertia"], small["inertia"]
    if not _less(whole, motor):
        return
    if fast is not None and fast.valid and "inertia" in fast and not _less(fast["inertia"], motor):
        return
    where = f" (about {math.sqrt(kp / motor.value) / (2.0 * math.pi):.0f} Hz)" if kp else ""
    raise NotTunable(
        f"the load does not go with the motor: small motion shows an inertia of {motor.value:.3g}, the motion as a "
        f"whole {whole.value:.3g} (at least {AGREES:g} of it is asked for), and no known effect explains that. "
        f"A soft transmission resonates about the position loop's bandwidth{where}, or there is play. What would be "
        "learned is the motor without its load; tighten coupling, belt and clamps, lower the gains or put a notch "
        "filter there, then run again"
    )


def refuse_loose_load(recording: Recording, kp: float | None) -> None:
    """Looks at the response from torque to motor at high speed, whatever the fits have made of it.

    Args:
        recording: of the experiments; kp: of the position loop, N m/rad or N/m.

    Raises:
        NotTunable: the load's own resonance lies below what the position loop's bandwidth is for the motor alone.
    """
    part = recording.select("high_speed")
    if not kp or len(part) == 0:
        return
    try:
        found = antiresonance(part)
    except NotEnoughExcitation:
        return
    if found is None:
        return
    bandwidth = math.sqrt(kp / found.inertia) / (2.0 * math.pi)
    if found.frequency < bandwidth:
        raise NotTunable(
            f"the load does not go with the motor: at {found.frequency:.0f} Hz the motor stands still and the load "
            f"swings, and the position loop's bandwidth is {bandwidth:.0f} Hz for the motor alone. What would be "
            "learned is the motor without its load, and tracking better would cost damping; tighten coupling, belt "
            "and clamps, lower the gains or put a notch filter there, then run again"
        )


def refuse_resonance(model: DriveModel | None, kp: float | None) -> None:
    """Looks at the soft transmission that was named, if one was.

    Raises:
        NotTunable: both masses swing against each other about the bandwidth of the position loop, or below it.
    """
    if model is None or not kp or ELASTIC_TRANSMISSION.name not in {effect.name for effect in model.effects}:
        return
    share, compliance = (model[ELASTIC_TRANSMISSION.surface(name)] for name in ("load_inertia", "compliance"))
    if not compliance * share * (1.0 - share) > 0.0:
        return
    bandwidth = math.sqrt(kp / model["inertia"]) / (2.0 * math.pi)
    resonance = bandwidth / math.sqrt(compliance * share * (1.0 - share) * kp)
    if resonance < RESONANT * bandwidth:
        raise NotTunable(
            f"motor and load swing against each other at {resonance:.0f} Hz, about the position loop's bandwidth of "
            f"{bandwidth:.0f} Hz (at least {RESONANT:g} times that is asked for): tracking better would cost damping, "
            "and the load would not follow. Tighten coupling, belt and clamps, lower the gains or put a notch filter "
            "there, then run again"
        )


def _less(whole: Quantity, motor: Quantity) -> bool:
    spread = math.hypot(whole.standard_error, AGREES * motor.standard_error)
    return whole.value < AGREES * motor.value - ERRORS * spread
