"""Commands that do not reach the simulated drive as they were sent: lost on their way, or another master's.

While one of these rehearsals is on, what the drive obeys is read back as a driver in front of it would.
"""

from __future__ import annotations

import math

from autotune.core.drive import Command
from autotune_sim.read_back import ReadBack


class AlteredCommands:
    """What the drive hears since power came on; `sent` is the last position that it was sent [rad]."""

    def __init__(self, sent: float) -> None:
        self.sent = sent
        self._told: Command | None = None
        self._foreign = math.nan
        self._read_back = ReadBack()

    def heard(self, command: Command, counts: int, lost: bool, foreign: float) -> Command:
        """The command that reaches the servo loop: an earlier one where ours are `lost`, or another master's target.

        Args:
            counts: which value of a command is the target in the present mode.
            foreign: another master's target, if it were to begin now [rad].

        Raises:
            LinkError: it is not ours, and looking has shown it.
        """
        if not math.isnan(command.position):
            self.sent = command.position
        sent = command._replace(position=self.sent)
        if lost:
            self._told = self._told or sent
            heard = self._told
        else:
            if math.isnan(self._foreign):
                self._foreign = foreign
            heard = sent._replace(position=self._foreign)
        self._read_back.cycle(_target(sent, counts), _target(heard, counts))
        return heard


def _target(command: Command, counts: int) -> tuple[float, float]:
    return command[counts], command.torque_feedforward
