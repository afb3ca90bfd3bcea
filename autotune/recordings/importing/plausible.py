"""Does what was imported behave like an axis: signs, velocity against position, clipped torque.

The sign of the torque is judged by energy. What the motor has put in up to a moment is
W = ∫ τ dq = ½ J v² + F ∫ |v| dt + c₁ q + c₂ q² with J > 0 and F > 0 on every real axis. A regression
of W on these terms needs no acceleration, so noise hardly matters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.axis_sizes import GRAVITY, sizes
from autotune.recordings.checks import clipped
from autotune.recordings.recording import Recording
from autotune.signals.filters import low_pass

_MOST_ROWS = 400_000
_USUAL_HALF, _MOST_USUAL = 10.0, 50.0
"""Hz, below which half of a servo axis's work is done, and at most."""
_LEAST_FOLLOWED = 0.1
_SURE = 0.5
"""Of what is left without a term, the share it must explain before its coefficient is compared with decades."""
_RATIOS = {
    "rpm": 60.0 / (2.0 * math.pi),
    "deg/s": 180.0 / math.pi,
    "turns a second": 1.0 / (2.0 * math.pi),
    "mm/s": 1e3,
}
_OF_POSITIONS = {"deg": math.pi / 180.0, "turns": 2.0 * math.pi, "mm": 1e-3}
"""The same of a velocity in rad/s or m/s beside a position in another unit."""


@dataclass(frozen=True, slots=True)
class Energy:
    """Result of the regression: shares of the work explained by inertia and friction, with their signs.

    Attributes:
        inertia, force: J and F, in the units of the recording.
        sure: each of the two by itself explains work that nothing else does.
    """

    kinetic: float
    friction: float
    explained: float
    inertia: float = 0.0
    force: float = 0.0
    sure: bool = False

    @property
    def negative(self) -> bool:
        """Beyond doubt: the axis would give energy to the motor.

        Shares far above 1 come from terms that cannot be told apart (one direction only), unless they
        explain nearly everything; small ones come from noise.
        """
        both, size = self.kinetic + self.friction, abs(self.kinetic) + abs(self.friction)
        most = 20.0 if self.explained > 0.9 else 2.0
        return self.explained > 0.5 and both < -0.6 * size and 0.3 < size < most


def refuse_wrong_sign(recording: Recording, where: str) -> None:
    """Raises RecordingError where torque and motion count in opposite directions."""
    parts = _parts(recording)
    energy = energy_balance(parts)
    if energy is not None and energy.negative and _two_ways(parts) and _follows(parts):
        raise RecordingError(
            f"{where}: the torque acts against the motion it causes (inertia and friction come out negative): "
            "torque and position count in opposite directions. Turn one of them, for example "
            "'--column torque=FIELD*-1'; or say --keep-signs if the drive really brakes all the time"
        )


def _parts(recording: Recording) -> list[Recording]:
    """At most 64 segments of at least 50 rows, each with an equal share of the rows that are looked at."""
    segments = [segment for segment in recording.segments() if segment.stop - segment.start >= 50]
    segments = segments[:: max(1, -(-len(segments) // 64))]
    most = _MOST_ROWS // max(len(segments), 1)
    return [recording.rows(slice(s.start, min(s.stop, s.start + most))) for s in segments]


def energy_balance(parts: list[Recording]) -> Energy | None:
    """One regression over all segments; None where the axis hardly moves."""
    sums = [_work_and_terms(part) for part in parts]
    if not sums:
        return None
    return _regress(np.concatenate([one[0] for one in sums]), np.concatenate([one[1] for one in sums]))


def _work_and_terms(part: Recording) -> tuple[Floats, Floats]:
    """Work done since the segment's start, shape (n,), and its terms, shape (n, 5)."""
    smooth = low_pass(part["position"], min(50.0 * _times_as_fast(part), 0.1 / part.period), part.period)
    step = np.diff(smooth)
    velocity = step / part.period
    work = np.cumsum(0.5 * (part["torque"][1:] + part["torque"][:-1]) * step)
    place = 0.5 * (smooth[1:] + smooth[:-1]) - smooth[0]
    kinetic = 0.5 * (velocity**2 - velocity[0] ** 2)
    return work, np.column_stack([kinetic, np.cumsum(np.abs(step)), place, place**2, np.ones(len(place))])


def _times_as_fast(part: Recording) -> float:
    """How many times as fast as a servo axis: 1 where half of the work is done below 50 Hz, more for a piezo's axis."""
    window = min(4096, len(part) // 4)
    speed = np.diff(part["position"])
    if window < 16 or not np.any(speed):
        return 1.0
    frequency, work = scipy.signal.csd(
        part["torque"][1:], speed, 1.0 / part.period, nperseg=window, detrend=False
    )
    done = np.abs(np.cumsum(work.real))
    half = float(frequency[int(np.argmax(done >= 0.5 * done[-1]))])
    return half / _USUAL_HALF if half > _MOST_USUAL else 1.0


def _regress(work: Floats, terms: Floats) -> Energy | None:
    scale = np.std(terms, axis=0)
    scale[-1] = 1.0
    total = float(np.std(work))
    if total == 0.0 or scale[1] == 0.0:
        return None
    scale[scale == 0.0] = 1.0
    normal = terms / scale
    full, *_ = np.linalg.lstsq(normal, work, rcond=1e-9)
    less, *_ = np.linalg.lstsq(normal[:, 2:], work, rcond=1e-9)
    left, without = float(np.var(work - normal @ full)), float(np.var(work - normal[:, 2:] @ less))
    explained = 1.0 - left / without if without > 1e-9 * total**2 else 0.0
    sure = explained > _SURE and all(left < (1.0 - _SURE) * _left_without(normal, work, i) for i in (0, 1))
    inertia, force = float(full[0] / scale[0]), float(full[1] / scale[1])
    return Energy(float(full[0]) / total, float(full[1]) / total, explained, inertia, force, sure)


def _left_without(terms: Floats, work: Floats, index: int) -> float:
    """Variance that the other terms leave."""
    others = np.delete(terms, index, axis=1)
    return float(np.var(work - others @ np.linalg.lstsq(others, work, rcond=1e-9)[0]))


def sizes_of_dynamics(recording: Recording) -> dict[str, float]:
    """Those of `axis_sizes.RANGES` that inertia and friction tell; empty where the work does not show both."""
    energy, speed = energy_balance(_parts(recording)), sizes(recording).speed
    if energy is None or not energy.sure or min(energy.inertia, energy.force, speed) <= 0.0:
        return {}
    found = {"coasting": energy.inertia * speed / energy.force}
    if recording.metadata.motion_unit == "m" and not recording.metadata.torque_unit:
        found["weight"] = energy.force / (energy.inertia * GRAVITY)
    return found


def _follows(parts: list[Recording]) -> bool:
    """Whether the torque follows the motion at all: of a torque of something else no sign can be wrong."""
    terms, torques = [], []
    for part in parts:
        cutoff = min(20.0 * _times_as_fast(part), 0.05 / part.period)
        place = low_pass(part["position"], cutoff, part.period) - part["position"][0]
        velocity = np.gradient(place, part.period)
        acceleration = np.gradient(velocity, part.period)
        columns = [acceleration, velocity, np.sign(velocity), place, place**2, np.ones(len(part))]
        terms.append(np.column_stack(columns))
        torques.append(low_pass(part["torque"], cutoff, part.period))
    table, torque = np.concatenate(terms), np.concatenate(torques)
    table = table / np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    left = torque - table @ np.linalg.lstsq(table, torque, rcond=1e-9)[0]
    return float(np.var(left)) < (1.0 - _LEAST_FOLLOWED) * float(np.var(torque))


def _two_ways(parts: list[Recording]) -> bool:
    """Both directions occur: a load that drives one direction cannot be the reason."""
    up = sum(float(np.sum(np.maximum(np.diff(part["position"]), 0.0))) for part in parts)
    down = sum(float(np.sum(np.maximum(-np.diff(part["position"]), 0.0))) for part in parts)
    return min(up, down) > 0.05 * max(up, down)


def refuse_other_velocity(recording: Recording, where: str) -> None:
    """Raises RecordingError where velocity is not the derivative of position: sign or unit.

    A velocity that hardly follows the position (noise, a slow estimator) is left alone, and so is a part of it that
    lacks a number.
    """
    if "velocity" not in recording:
        return
    derived, given = [], []
    for part in _parts(recording):
        if not np.all(np.isfinite(part["velocity"])):
            continue
        cutoff = min(20.0, 0.05 / part.period)
        derived.append(np.gradient(low_pass(part["position"], cutoff, part.period), part.period))
        given.append(low_pass(part["velocity"], cutoff, part.period))
    if not derived:
        return
    one, other = np.concatenate(derived), np.concatenate(given)
    size = math.sqrt(float(one @ one) * float(other @ other))
    if size == 0.0 or abs(float(one @ other)) < 0.9 * size:
        return
    ratio = float(one @ other) / float(one @ one)
    if not 0.7 < ratio < 1.4:
        raise RecordingError(f"{where}: {_velocity_sentence(ratio, recording.metadata.motion_unit)}")


def _velocity_sentence(ratio: float, motion_unit: str) -> str:
    sign = "-" if ratio < 0 else ""
    unit = next((name for name, value in _RATIOS.items() if 0.9 < abs(ratio) / value < 1.1), "")
    if 0.7 < -ratio < 1.4:
        return (
            "velocity and the derivative of position have opposite signs; turn one of them, for example "
            "'--column velocity=FIELD*-1'"
        )
    place = next((name for name, value in _OF_POSITIONS.items() if 0.97 < ratio / value < 1.03), "")
    if place and (place == "mm") is (motion_unit == "m"):
        return (
            f"velocity is {ratio:.4g} times the derivative of position, as if it were in {motion_unit}/s and the "
            f"position in {place}; give the units of both, for example '--column position=FIELD*{place}'"
        )
    kind = f", as if it were in {unit}" if unit else ""
    return (
        f"velocity is {ratio:.4g} times the derivative of position{kind}; give the units of both, for example "
        f"'--column velocity=FIELD*{sign}rpm', or a factor of {1.0 / ratio:.6g}"
    )


def clipping_note(recording: Recording) -> str:
    """A sentence where the torque has flat tops; empty where it has none."""
    found = clipped(recording)
    torque = recording["torque"]
    if not found.rows.any() or found.limit == 0.0 or float(np.ptp(torque)) == 0.0:
        return ""
    first = float(recording["time"][int(np.argmax(found.rows))])
    share = f"{100 * found.share:.2g} %"
    return f"{share} of the rows are at ±{found.limit:.6g}, first at {first:.6g} s: the torque seems clipped"


def constant_notes(recording: Recording) -> list[str]:
    """A sentence for each column that never changes."""
    return [
        f"{name} is {recording[name][0]:g} in all rows; nothing can be identified from it"
        for name in ("position", "torque")
        if float(np.ptp(recording[name])) == 0.0
    ]
