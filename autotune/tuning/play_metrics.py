"""What a player does, as a text file for the node exporter of Prometheus (its textfile collector)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from prometheus_client import CollectorRegistry, Counter, Gauge, write_to_textfile

from autotune.control.torque_offset import Phase
from autotune.core.errors import ConfigurationError
from autotune.tuning.play import Player

EVERY = 5.0  # s


class PlayMetrics:
    """Writes the file `path`, replaced in one step."""

    def __init__(self, path: Path, axis: str) -> None:
        self._path, self._axis = path, axis
        self._told = False

    def keep_up(self, player: Player, say: Callable[[str], None]) -> None:
        """As `write`; a file that cannot be written is told of once, and is no reason to drop an offset."""
        try:
            self.write(player)
        except ConfigurationError as error:
            if not self._told:
                say(f"{error}; what is played does not depend on it")
            self._told = True

    def write(self, player: Player) -> None:
        """Raises ConfigurationError: the file cannot be written."""
        registry = CollectorRegistry()

        def gauge(name: str, about: str, value: float) -> None:
            Gauge(f"autotune_play_{name}", about, ["axis"], registry=registry).labels(self._axis).set(value)

        def counter(name: str, about: str, value: float) -> None:
            Counter(f"autotune_play_{name}", about, ["axis"], registry=registry).labels(self._axis).inc(value)

        offset = player.offset
        gauge(
            "playing", "1 while the offset is faded in or follows the model.", offset.phase is Phase.PLAYING
        )
        gauge("gain_ratio", "How far the offset is faded in, 0 to 1.", offset.gain)
        gauge("torque_offset", "Sent last [N m or N].", offset.value)
        counter("syncs", "SYNC messages heard.", player.syncs)
        counter("frames", "Frames with an offset sent.", player.sent)
        counter(
            "held_up", "Times that this host was too late, and the drive dropped the offset.", player.held_up
        )
        counter("limited_steps", "Cycles in which the step of the offset was limited.", offset.limited)
        try:
            write_to_textfile(str(self._path), registry)
        except OSError as error:
            raise ConfigurationError(
                f"metrics file {self._path} cannot be written ({error.strerror}); choose another place"
            ) from error
