"""What the experiments of section 3.4 look like: characteristic, presliding, Dahl's curve, methods compared."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from autotune.core.arrays import Floats
from autotune.identify.dahl import Dahl
from autotune.identify.estimate import Estimate
from autotune.identify.presliding import Presliding
from autotune.identify.steady_state import SteadyState
from autotune.view import data
from autotune.view.report import Picture, Table
from autotune.view.scale import significant

if TYPE_CHECKING:
    from autotune.identify.presliding import LinearFit
    from autotune.identify.run import Identification


def identification_pictures(found: Identification, motion_unit: str) -> list[Picture]:
    """Those of the experiments that were made."""
    pictures = []
    if found.steady_state is not None and found.steady_state.curves:
        pictures.append(steady_state_picture(found.steady_state, motion_unit))
    if found.presliding is not None:
        adopted = found.estimates.get("presliding")
        pictures.append(presliding_picture(found.presliding, adopted, motion_unit))
    if found.dahl is not None:
        pictures.append(dahl_picture(found.dahl, found.joint, motion_unit))
    return pictures


def steady_state_picture(steady: SteadyState, motion_unit: str, torque_unit: str = "") -> Picture:
    """Torque at constant speed with the best shape (figure 6.11)."""
    from autotune.view import figures

    caption = (
        "Torque at constant speed: Coulomb level, viscous slope, and a dip at low speed where there is one."
    )
    shown = steady_state_data(steady, motion_unit, torque_unit)
    return Picture("Steady-state characteristics", caption, figures.steady_state(shown))


def steady_state_data(steady: SteadyState, motion_unit: str, torque_unit: str = "") -> data.SteadyState:
    """The measured points and the best shape."""
    speed = np.abs(steady.points.velocity)
    grid = np.geomspace(speed.min(), speed.max(), 150)
    both = np.concatenate([-grid[::-1], grid])
    return data.SteadyState(
        steady.points.velocity,
        steady.points.torque,
        1.96 * steady.points.standard_error,
        both,
        steady.curves[0].predict(both),
        motion_unit,
        torque_unit,
    )


def presliding_picture(small: Presliding, estimate: Estimate | None, motion_unit: str) -> Picture:
    """Response inside presliding, and the stiffness by method and set (figure 6.12)."""
    from autotune.view import figures

    estimates = {
        method: [fit.system.stiffness for fit in fits if fit.system is not None]
        for method, fits in small.comparison.items()
    }
    shown = data.Presliding(
        small.time,
        small.torque,
        small.position,
        small.predicted,
        estimates,
        _adopted(estimate),
        motion_unit,
    )
    caption = (
        "Small displacements: the contact is a spring with a damper; crosses compare the methods set by set."
    )
    return Picture("Presliding", caption, figures.presliding(shown))


def dahl_picture(curve: Dahl, joint: Estimate, motion_unit: str) -> Picture:
    """Torque over position through slow reversals (figure 6.13)."""
    from autotune.view import figures

    shown = data.DahlCurve(
        curve.position,
        curve.torque,
        curve.predicted,
        joint.value("coulomb"),
        joint.value("offset", 0.0),
        motion_unit,
    )
    caption = "Torque over position through slow reversals; the slope after a reversal is the stiffness."
    return Picture("Dahl's curve", caption, figures.dahl_curve(shown))


def methods_table(comparison: Mapping[str, tuple[LinearFit, ...]], motion_unit: str) -> Table:
    """Mean and scatter over the sets of what each method says about presliding, beside figure 6.12."""
    names = ("inertia", "damping", "stiffness")
    rows = []
    for method, fits in comparison.items():
        systems = [fit.system for fit in fits if fit.system is not None]
        cells = []
        for name in names:
            values = np.array([getattr(system, name) for system in systems])
            cells.append(_spread(values))
        rows.append([method, f"{len(systems)} of {len(fits)}", *cells])
    torque = data.torque_unit(motion_unit)
    columns = (
        "method",
        "sets",
        "inertia [kg m²]" if motion_unit == "rad" else "mass [kg]",
        f"σ1 + σ2 [{torque} s/{motion_unit}]",
        f"stiffness [{torque}/{motion_unit}]",
    )
    note = (
        "Mean ± standard deviation over the sets; a method without a stable system in a set leaves it out. LS: least "
        "squares, IV: instrumental variables, dv: with the means taken out, BJ: Box-Jenkins."
    )
    return Table("Presliding: methods compared", columns, rows, note, frozenset({2, 3, 4}))


def _spread(values: Floats) -> str:
    if not len(values):
        return "none"
    if len(values) == 1:
        return significant(float(values[0]))
    return f"{significant(float(np.mean(values)))} ± {significant(float(np.std(values, ddof=1)), 2)}"


def _adopted(estimate: Estimate | None) -> tuple[float, float] | None:
    if estimate is None or not estimate.valid or "stiffness" not in estimate:
        return None
    return estimate["stiffness"].value, estimate["stiffness"].standard_error
