"""A torque offset that is faded in after checks, faded out on doubt, and never makes a step.

    u_k = u_{k−1} + clip(g_k τ_k − u_{k−1}, ±s)

τ is the feedforward's torque, g a gain between 0 and 1, and s `STEP` of the torque limit: two frames that meet
in one cycle of the drive make less than 5 %, the rounding of both to the drive's steps included.
"""

from __future__ import annotations

from enum import Enum

import numpy as np

from autotune.core.arrays import Floats

STEP = 0.024
"""Of the torque limit, in one frame."""
FADE_IN, FADE_OUT = 0.5, 0.1  # s
_SAMPLES = 400  # in motion, before a model is judged
_TURNS = 2
_AVERAGED = 20  # samples in a row
_EACH_WAY = 100  # of them in either direction
SCALE = (0.75, 1.3)  # torque measured by torque of the model
UNEXPLAINED = 0.25  # of the spread of the torque


class Phase(Enum):
    """What the sidecar does."""

    WATCHING = "watching"
    PLAYING = "playing"
    LEAVING = "leaving"


class TorqueOffset:
    """The offset from cycle to cycle.

    Attributes:
        value: what was sent last [N m].
        gain: 0…1.
        limited: cycles in which the step was limited.
    """

    def __init__(self, limit: float, period: float) -> None:
        self.value = self.gain = 0.0
        self.phase = Phase.WATCHING
        self.limited = 0
        self._limit, self._step = limit, STEP * limit
        self._in, self._out = period / FADE_IN, period / FADE_OUT

    def step(self, torque: float) -> float:
        """Offset of the next cycle, given the feedforward's torque [N m]."""
        playing = self.phase is Phase.PLAYING
        self.gain = min(self.gain + self._in, 1.0) if playing else max(self.gain - self._out, 0.0)
        wanted = self.gain * max(-self._limit, min(self._limit, torque))
        change = wanted - self.value
        if abs(change) > self._step:
            self.limited += 1
            change = self._step if change > 0.0 else -self._step
        self.value += change
        return self.value

    def begin_again(self) -> None:
        """The drive has dropped it: nothing stands."""
        self.value = self.gain = 0.0

    @property
    def out(self) -> bool:
        """Nothing of the offset is left."""
        return self.phase is not Phase.PLAYING and self.gain == 0.0 and self.value == 0.0


class ModelCheck:
    """Whether a model fits the axis: torque measured on the first moves by torque of the model, no offset yet.

    What the contact remembers from before is not known; samples count once the axis has turned round twice. Means
    of `_AVERAGED` samples are compared: a drive that differentiates counts twice has noise as large as friction.

    Attributes:
        done: there is enough to judge.
    """

    def __init__(self, slow: float) -> None:
        """`slow`: speed below which a sample does not count as motion."""
        self._slow = slow
        self._rows: list[tuple[float, float]] = []
        self._ways = [0, 0]
        self._turns = 0
        self._forward: bool | None = None
        self.done = False

    def see(self, velocity: float, model: float, measured: float) -> None:
        """Takes a cycle: velocity of the reference, torques [N m]."""
        if abs(velocity) < self._slow or self.done:
            return
        before, self._forward = self._forward, velocity > 0.0
        self._turns += before is not None and before is not self._forward
        if self._turns < _TURNS:
            return
        self._ways[velocity > 0.0] += 1
        self._rows.append((model, measured))
        self.done = len(self._rows) >= _SAMPLES and min(self._ways) >= _EACH_WAY

    def doubt(self) -> str:
        """Why the model does not fit, in words; empty where it does."""
        whole = len(self._rows) // _AVERAGED * _AVERAGED
        model, measured = np.array(self._rows[:whole]).reshape(-1, _AVERAGED, 2).mean(axis=1).T
        scale, unexplained = _agreement(model, measured)
        if SCALE[0] <= scale <= SCALE[1] and unexplained <= UNEXPLAINED:
            return ""
        return (
            f"the model does not fit the axis: measured on the first moves is {scale:.2f} times its torque "
            f"({SCALE[0]:g} to {SCALE[1]:g} allowed), {unexplained:.0%} of the spread is unexplained ("
            f"{UNEXPLAINED:.0%} allowed). Run 'autotune check', and tune again where the axis has changed"
        )


def _agreement(model: Floats, measured: Floats) -> tuple[float, float]:
    """Slope of measured over model torque, and the share of the measured spread that it leaves; shapes (n,)."""
    x, y = model - np.mean(model), measured - np.mean(measured)
    spread = float(np.sqrt(y @ y))
    power = float(x @ x)
    if power <= 0.0 or spread <= 0.0:
        return 0.0, 1.0
    slope = float(x @ y) / power
    rest = y - slope * x
    return slope, float(np.sqrt(rest @ rest)) / spread
