"""The two axes behind the socket: simulated drives in torque mode, stepped once for each message.

Usage: axes.py SOCKET SEED_X SEED_Y. Ends when the controller has gone, and leaves axes.npy: for each message
what was told (see autotune_test_axes.comp) and where the two axes truly were then, shape (n, 14).
"""

from __future__ import annotations

import socket
import struct
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from autotune.control.model_feedforward import ModelFeedforward
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.table import EFFECTS
from autotune_sim.presets import preset
from autotune_sim.servo import Servo, ServoMode

QUESTION, ANSWER = struct.Struct("12d"), struct.Struct("2d")


def true_model(seed: int) -> DriveModel:
    """The simulated axis in the words of a drive model: what a perfect identification would find."""
    plant = preset("edm-vertical", seed).plant
    base = {
        "inertia": plant.inertia,
        "viscous": plant.viscous,
        "coulomb": 1e-3,
        "stiffness": 1.0,
        "micro_damping": plant.micro_damping,
        "offset": plant.offset,
    }
    memory: dict[str, float] = {}
    for i, element in enumerate(plant.elements, 1):
        memory |= {f"displacement_{i}": element.displacement, f"torque_{i}": element.torque}
    ripple: dict[str, float] = {}
    for i, wave in enumerate(plant.ripple, 1):
        sine, cosine = wave.amplitude * np.cos(wave.phase), wave.amplitude * np.sin(wave.phase)
        ripple |= {f"order_{i}": wave.order, f"sin_{i}": sine, f"cos_{i}": cosine}
    model = base_model(base).with_effect(EFFECTS["reversal_memory"].make(memory))
    return model.with_effect(EFFECTS["torque_ripple"].make(ripple))


class SimulatedAxis:
    """A drive in torque mode, and the feedforward of its own inverse."""

    def __init__(self, seed: int) -> None:
        self.servo = Servo(preset("edm-vertical", seed), seed)
        self._inverse = ModelFeedforward(true_model(seed), self.servo.period)
        self._inverse.prepare()
        self.servo.idle()

    def step(self, powered: bool, inverse: bool, told: tuple[float, ...]) -> float:
        """One period; returns the encoder's reading after it [rad]."""
        torque, offset, position, velocity, acceleration = told
        own = self._inverse.step(position, velocity, acceleration, None)
        if powered != self.servo.powered:
            self.servo.power(powered, ServoMode.TORQUE)
        self.servo.cycle(target_torque=torque, torque_offset=own if inverse else offset)
        return self.servo.position


def _answered(wire: socket.socket, axes: list[SimulatedAxis]) -> Iterator[tuple[float, ...]]:
    """Steps the axes for each message until there are no more; yields the rows of the log."""
    with suppress(ConnectionResetError):
        while question := wire.recv(QUESTION.size):
            told = QUESTION.unpack(question)
            powered, inverse = told[0] != 0.0, told[1] != 0.0
            true = [axis.servo.true_position for axis in axes]
            rows = (told[2:7], told[7:12])
            reached = [axis.step(powered, inverse, row) for axis, row in zip(axes, rows, strict=True)]
            wire.send(ANSWER.pack(*reached))
            yield (*told, *true)


def main(path: str, *seeds: str) -> None:
    """Answers until the other end is closed."""
    axes = [SimulatedAxis(int(seed)) for seed in seeds]
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as door:
        door.bind(path)
        Path(path).chmod(0o777)
        door.listen(1)
        print("listening", flush=True)
        wire, _ = door.accept()
        with wire:
            log = list(_answered(wire, axes))
    np.save("axes.npy", np.array(log))


if __name__ == "__main__":
    main(*sys.argv[1:])
