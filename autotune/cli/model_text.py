"""What `autotune model` prints for people: the facts of `--json` as lines."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from pathlib import Path

from autotune.api.results import AddedEffect, Comparison, DiagnosisResult
from autotune.diagnosis.wording import headline
from autotune.models.drive_model import DriveModel, staircase
from autotune.models.table import effect_kind
from autotune.models.torque_ripple import TORQUE_RIPPLE
from autotune.models.waves import Wave, ripple_waves
from autotune.view.model_pages import floor_range
from autotune.view.scale import quantity

BAR, MOST_ROWS = 40, 6


def compared_lines(result: Comparison) -> Iterator[str]:
    unit = result.torque_unit
    yield f"error {quantity(result.error_rms, unit)} rms, {100 * result.relative_error:.2f} % of the torque"
    interval = result.noise_floor_interval
    if interval is None:
        yield "noise floor unknown: nothing was recorded twice"
        yield f"explains {100 * result.explained:.2f} % of the torque's variance; what is noise of the rest is unknown"
    else:
        yield f"noise floor {quantity(result.noise_floor_rms, unit)} rms{floor_range(interval, unit)}"
        if result.error_rms <= interval[1]:
            yield "the error is not above what noise leaves"
        yield f"explained {100 * result.explained:.2f} % of what can be explained"
    for name, value in result.regimes.items():
        if math.isfinite(value):
            yield f"  {name.replace('_', ' '):<14}{quantity(value, unit)}"
    for worst in result.worst[:3]:
        yield (
            f"worst where {worst.coordinate.replace('_', ' ')} is {worst.low:.4g} to {worst.high:.4g}: "
            f"{100 * worst.share:.0f} % of the squared error"
        )


def diagnosis_lines(result: DiagnosisResult) -> Iterator[str]:
    unit = result.torque_unit
    yield headline(result.verdict, result.effects, result.confidence, result.complete, result.twin)
    for effect in result.effects:
        kind = effect_kind(effect)
        yield f"  looks like: {kind.looks_like}"
        yield f"  caused by:  {kind.cause}"
        yield f"  what to do: {kind.remedy}"
    for rivals in result.confusable:
        yield f"cannot be told apart for certain: {', '.join(rivals)}"
    yield "candidates, accepted ones first, by how far the squared error falls on unseen experiments:"
    for rank, c in enumerate(result.candidates):
        if rank >= MOST_ROWS and not c.accepted:
            break
        mark = "*" if c.accepted else " "
        yield f" {mark} {c.effect:<27} {100 * c.gain:6.1f} %  {c.why}"
    if math.isfinite(result.noise_floor_rms):
        yield f"noise floor {quantity(result.noise_floor_rms, unit)} rms"
    where = sorted(result.where.items(), key=lambda item: -item[1])[:3]
    yield "where it sits: " + ", ".join(f"{n.replace('_', ' ')} {100 * s:.0f} %" for n, s in where)
    if result.next_experiment:
        yield f"next: {result.next_experiment}"
    yield from result.notes


def added_lines(result: AddedEffect, out: Path | None) -> Iterator[str]:
    unit = result.model.torque_symbol
    fall = 1.0 - result.error_after / result.error_before if result.error_before else 0.0
    yield (
        f"error on {result.unseen}: {quantity(result.error_before, unit)} refitted without "
        f"{result.effect.replace('_', ' ')}, {quantity(result.error_after, unit)} with it ({-100 * fall:+.0f} %)"
    )
    if math.isfinite(result.noise_floor_rms):
        yield f"noise floor {quantity(result.noise_floor_rms, unit)}, an estimate"
    kind = effect_kind(result.effect)
    own = {kind.surface(p.name) for p in kind.parameters}
    yield from (f"  {line}" for line in _lines_of(result.model, own))
    if out is not None:
        yield f"written to {out}"


def parameter_lines(model: DriveModel) -> Iterator[str]:
    """One line a parameter; a wave of the torque ripple is one line, by order, amplitude and phase."""
    return _lines_of(model, set(model.parameters))


def _lines_of(model: DriveModel, names: Collection[str]) -> Iterator[str]:
    waves = {TORQUE_RIPPLE.surface(f"order_{wave.number}"): wave for wave in ripple_waves(model)}
    for name, value in model.parameters.items():
        if name not in names:
            continue
        if name in waves:
            yield _wave(model, waves[name])
        elif not name.startswith(TORQUE_RIPPLE.surface("")):
            yield _parameter(model, name, value.value, value.standard_error)


def _wave(model: DriveModel, wave: Wave) -> str:
    spread = f" ± {wave.standard_error:.2g}" if wave.standard_error is not None else ""
    order = f"{wave.order:.5g} {model.unit(TORQUE_RIPPLE.surface(f'order_{wave.number}'))}"
    where = f"at {order}, phase {math.degrees(wave.phase):.0f}°"
    return f"{f'{TORQUE_RIPPLE.name} {wave.number}':<36}{wave.amplitude:.5g}{spread} {model.torque_symbol} {where}"


def model_lines(model: DriveModel) -> Iterator[str]:
    """Parameters, and the story of the model as a falling staircase."""
    yield f"model of {model.axis or 'an axis'}, motion in {model.motion_unit}"
    yield from (f"  {line}" for line in parameter_lines(model))
    steps = [entry for entry in model.history if entry.error_after is not None]
    if not steps:
        yield "no history"
        return
    unit = model.torque_symbol
    which = f" ({steps[-1].unseen})" if steps[-1].unseen else ""
    yield f"error on data that the fit never saw{which}, step by step:"
    stairs = staircase(model.history)
    largest = max(stair.error for stair in stairs)
    before: float | None = None
    for stair in stairs:
        yield _stair(stair.action, before, stair.error, largest, unit)
        before = stair.error
    floor = steps[-1].noise_floor
    if floor is not None:
        length = min(round(BAR * floor / largest), BAR) if largest else 0
        yield f"  {'noise floor (an estimate)':<30}{'.' * length:<{BAR}} {quantity(floor, unit)}"


def _stair(action: str, before: float | None, after: float, largest: float, unit: str) -> str:
    bar = "█" * max(1, round(BAR * after / largest)) if largest else ""
    change = f" ({100 * (after / before - 1.0):+.0f} %)" if before else ""
    return f"  {action:<29} {bar:<{BAR}} {quantity(after, unit)}{change}"


def _parameter(model: DriveModel, name: str, value: float, error: float | None) -> str:
    spread = f" ± {error:.2g}" if error is not None else ""
    unit = model.unit(name)
    return f"{name:<35} {value:.5g}{spread}{'' if unit == '1' else f' {unit}'}"
