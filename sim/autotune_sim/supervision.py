"""What the drive watches in every servo period: following error, speed, travel, temperature, inputs."""

from __future__ import annotations

from autotune_sim.emergency import ErrorCode
from autotune_sim.object_dictionary import ObjectDictionary
from autotune_sim.servo import Servo, ServoMode, ServoState

BEYOND = 0.03  # rad beyond a software limit, outward, that is a fault
OVERSPEED = 1.2
WARNING = 10.0  # °C below the temperature limit
CREEP = 0.1  # rad/s below which an axis is not on its way out


class Supervision:
    """Compares samples with the limits in the object dictionary.

    Attributes:
        enable_input, brake_input: digital inputs, for rehearsals.
        heating: added to the motor temperature [°C], for rehearsals.
        following_error: bit 13 of the status word.
    """

    def __init__(self, objects: ObjectDictionary, servo: Servo, rad_per_count: float) -> None:
        self.enable_input = True
        self.brake_input = True
        self.heating = 0.0
        self._servo = servo
        self._scale = rad_per_count
        self._window, self._time_out = objects[0x6065], objects[0x6066]
        self._lowest, self._highest = objects[0x607D, 1], objects[0x607D, 2]
        self._fastest = objects[0x607F]
        self._hottest = objects[0x2220, 2]
        self.reset()

    def reset(self) -> None:
        """Begins anew, as when power comes on."""
        self.following_error = False
        self._late_cycles = 0

    @property
    def window(self) -> float:
        """Following error allowed [rad]."""
        return int(self._window.value) * self._scale

    def temperature(self, sample: ServoState) -> float:
        """Of the motor [°C]."""
        return sample.temperature + self.heating

    def warm(self, sample: ServoState) -> bool:
        """Bit 7 of the status word: near the temperature limit."""
        return self.temperature(sample) > int(self._hottest.value) * 0.1 - WARNING

    def hot(self, sample: ServoState) -> bool:
        return self.temperature(sample) > int(self._hottest.value) * 0.1

    def standing(self, sample: ServoState, powered: bool) -> ErrorCode | None:
        """A fault that lasts as long as its cause."""
        if self.hot(sample):
            return ErrorCode.MOTOR_TEMPERATURE
        if powered and not self.enable_input:
            return ErrorCode.ENABLE_INPUT
        if powered and not self.brake_input:
            return ErrorCode.BRAKE
        return None

    def motion(self, sample: ServoState) -> ErrorCode | None:
        """A fault of the motion of a powered axis."""
        beyond = self._servo.mode is ServoMode.POSITION and abs(sample.following_error) > self.window
        self._late_cycles = self._late_cycles + 1 if beyond else 0
        allowed = max(int(self._time_out.value) * 1e-3 / self._servo.period, 1.0)
        self.following_error = self._late_cycles >= allowed
        if self.following_error:
            return ErrorCode.FOLLOWING_ERROR
        if abs(sample.velocity) > OVERSPEED * int(self._fastest.value) * self._scale:
            return ErrorCode.SPEED
        return ErrorCode.POSITION_LIMIT if self._outside(sample) else None

    def _outside(self, sample: ServoState) -> bool:
        if abs(sample.velocity) < CREEP:
            return False
        if sample.velocity > 0:
            return sample.position > int(self._highest.value) * self._scale + BEYOND
        return sample.position < int(self._lowest.value) * self._scale - BEYOND
