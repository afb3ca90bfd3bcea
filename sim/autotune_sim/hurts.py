"""What can break inside a simulated axis, whatever link is in front of it: sensor, motor, stage, load.

An order is `NAME[=VALUE]`, the same in `sim://...?fault=NAME=VALUE@SECONDS` and in `--fault` behind a wire.

| name | value | what happens |
|---|---|---|
| encoder-frozen | | the reading stays as it is |
| encoder-jump | rad (0.5) | the reading leaps once |
| encoder-reversed | | the reading runs backwards from here on |
| encoder-scale | factor (10) | the reading changes so many times as fast as the shaft turns |
| velocity-unit | factor (0.1) | the drive's own velocity is so many times the true one |
| torque-constant | factor (0.5) | the shaft gets so much of the torque that the drive believes in |
| torque-reversed | | the torque has the wrong sign |
| stage-stuck | N m (as now) | the output stage gives this torque, with and without power |
| runaway | share (1) of the torque limit | with power the stage gives this torque, whatever is demanded |
| load-step | share (0.45) of the torque limit | a torque from outside, from now on |
| load-wave | share (0.3) of the torque limit | a torque from outside that swings at 1.7 rad/s |
| leaning | share (0.2) of the torque limit | somebody leans on the table, now and then |
| inertia-step | factor (2) | a load is put on |
| end-stop | rad (0.05) | hard stops this far to both sides |
| collision | rad (0.05) | an obstacle this far ahead |
| temperature-frozen | | the temperature sensor is dead |
| temperature-slow | s (120) | the temperature sensor is slow |
| temperature-rise | °C (60) | the winding is warmer by so much at once, truly |
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from autotune.core.errors import ConfigurationError
from autotune_sim.servo import Servo

Act = Callable[[Servo, float], None]
_WAVE_RATE = 1.7  # rad/s
_SIGNED = r"[+-]?\d+(\.\d*)?"
_POSITIVE = r"\d+(\.\d*)?"


@dataclass(frozen=True, slots=True)
class Hurt:
    """One thing that can break: how, what its value may be, and the value where none is given."""

    act: Act
    pattern: str = ""
    words: str = "left out"
    default: float = math.nan

    def value(self, text: str) -> float:
        return float(text) if text else self.default


def apply_hurt(servo: Servo, name: str, value: str = "") -> None:
    """Breaks something now.

    Raises:
        ConfigurationError: an unknown name, or a value that cannot be.
    """
    check_hurt(name, value)
    HURTS[name].act(servo, HURTS[name].value(value))


def check_hurt(name: str, value: str = "") -> None:
    """Raises ConfigurationError where there is no such fault or it cannot have that value."""
    if name not in HURTS:
        near = difflib.get_close_matches(name, HURTS, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(HURTS)}"
        raise ConfigurationError(f"fault {name!r} is not known; {hint}")
    hurt = HURTS[name]
    if value and not (hurt.pattern and re.fullmatch(hurt.pattern, value)):
        raise ConfigurationError(f"fault {name!r}: value {value!r} must be {hurt.words}")


def _frozen(servo: Servo, _: float) -> None:
    servo.hurt(encoder_held=servo.position)


def _jump(servo: Servo, leap: float) -> None:
    servo.hurt(encoder_offset=servo.broken.get("encoder_offset", 0.0) + leap)


def _gear(servo: Servo, gain: float) -> None:
    """Another gain of the encoder, without a leap."""
    servo.hurt(encoder_gain=gain, encoder_offset=servo.position - gain * servo.true_position)


def _stuck(servo: Servo, torque: float) -> None:
    servo.hurt(stage_torque=servo.torque if math.isnan(torque) else torque, stage_live=1.0)


def _share(servo: Servo, share: float) -> float:
    return share * servo.preset.plant.torque_limit


def _end_stops(servo: Servo, distance: float) -> None:
    servo.hurt(stop_low=servo.true_position - distance, stop_high=servo.true_position + distance)


def _collision(servo: Servo, distance: float) -> None:
    if servo.true_velocity < 0.0:
        servo.hurt(stop_low=servo.true_position - distance)
    else:
        servo.hurt(stop_high=servo.true_position + distance)


HURTS: dict[str, Hurt] = {
    "encoder-frozen": Hurt(_frozen),
    "encoder-jump": Hurt(_jump, _SIGNED, "an angle in rad", 0.5),
    "encoder-reversed": Hurt(lambda servo, _: _gear(servo, -1.0)),
    "encoder-scale": Hurt(_gear, _SIGNED, "a factor", 10.0),
    "velocity-unit": Hurt(lambda servo, gain: servo.hurt(velocity_gain=gain), _SIGNED, "a factor", 0.1),
    "torque-constant": Hurt(lambda servo, gain: servo.hurt(torque_gain=gain), _SIGNED, "a factor", 0.5),
    "torque-reversed": Hurt(lambda servo, _: servo.hurt(torque_gain=-1.0)),
    "stage-stuck": Hurt(_stuck, _SIGNED, "a torque in N m"),
    "runaway": Hurt(
        lambda servo, share: servo.hurt(stage_torque=_share(servo, share)),
        _SIGNED,
        "a share of the torque limit",
        1.0,
    ),
    "load-step": Hurt(
        lambda servo, share: servo.hurt(push=_share(servo, share)),
        _SIGNED,
        "a share of the torque limit",
        0.45,
    ),
    "load-wave": Hurt(
        lambda servo, share: servo.hurt(push_wave=_share(servo, share), push_rate=_WAVE_RATE),
        _POSITIVE,
        "a share of the torque limit",
        0.3,
    ),
    "leaning": Hurt(
        lambda servo, share: servo.hurt(lean=_share(servo, share)),
        _SIGNED,
        "a share of the torque limit",
        0.2,
    ),
    "inertia-step": Hurt(lambda servo, factor: servo.scale_inertia(factor), _POSITIVE, "a factor", 2.0),
    "end-stop": Hurt(_end_stops, _POSITIVE, "a distance in rad", 0.05),
    "collision": Hurt(_collision, _POSITIVE, "a distance in rad", 0.05),
    "temperature-frozen": Hurt(lambda servo, _: servo.hurt(temperature_held=servo.temperature)),
    "temperature-slow": Hurt(
        lambda servo, lag: servo.hurt(temperature_time=lag), _POSITIVE, "a time constant in s", 120.0
    ),
    "temperature-rise": Hurt(lambda servo, rise: servo.warm(rise), _POSITIVE, "a temperature in °C", 60.0),
}
