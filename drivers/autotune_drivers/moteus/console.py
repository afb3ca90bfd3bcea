"""The diagnostic console of a moteus, tunnelled through its frames: `conf get`, `set`, `write`.

Bytes are polled with flow control where the firmware has it, so that a lost reply loses nothing of a
number. A lost command may be repeated, and a line may double one: what is said twice is thrown away before the next.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

from autotune.core.errors import LinkTimeout, TransferAborted
from autotune_drivers.moteus.multiplex import CHUNK, Reply, parse, stream_data, stream_poll
from autotune_drivers.moteus.node import MoteusNode

_POLL_BYTES = 48
_PAUSE = 0.002
_STALE = 0.01
_ANSWER = 1.0
_ENUMERATE = 20.0
_REFUSALS = ("ERR", "error", "unknown")


class Console:
    """Commands to one controller; each raises LinkError where it cannot be reached."""

    def __init__(self, node: MoteusNode) -> None:
        self._node = node
        self._text = b""
        self._flow: bool | None = None
        self._packet = 0
        self._stale = True

    def get(self, name: str) -> str:
        """The value of a parameter, as the controller writes it.

        Raises:
            TransferAborted: it does not have it.
        """
        return self._ask(f"conf get {name}", one_line=True)[0]

    def number(self, name: str) -> float:
        """The same as a number. Raises TransferAborted: none of that name, or it is no number."""
        text = self.get(name)
        try:
            return float(text)
        except ValueError:
            raise TransferAborted(
                f"controller {self._node.number} says {text!r} where {name} should be a number"
            ) from None

    def set(self, name: str, value: str) -> None:
        """Raises TransferAborted: no such parameter, or not this value."""
        self._ask(f"conf set {name} {value}")

    def enumerate(self) -> Mapping[str, str]:
        """All parameters."""
        lines = self._ask("conf enumerate", _ENUMERATE)
        pairs = (line.partition(" ") for line in lines)
        return {name: value for name, _, value in pairs if value}

    def load(self) -> None:
        """Stored values into the working ones."""
        self._ask("conf load")

    def write(self, seconds: float) -> None:
        """Stores the working values; `seconds` is the longest that it takes."""
        self._ask("conf write", seconds)

    # Below

    def _ask(self, command: str, seconds: float = _ANSWER, one_line: bool = False) -> list[str]:
        """Lines up to `OK`, or the one line that `conf get` answers with."""
        if self._stale or self._text.strip() or self._poll():  # an answer to nothing: a command came twice
            self._discard()
        self._stale = True
        repeated = False
        text = command.encode() + b"\n"
        for start in range(0, len(text), CHUNK):
            repeated |= self._node.tell(stream_data(text[start : start + CHUNK])) > 1
        lines = self._answer(command, time.monotonic() + seconds, one_line)
        self._stale = repeated
        return lines

    def _answer(self, command: str, end: float, one_line: bool) -> list[str]:
        lines: list[str] = []
        while True:
            line = self._line(command, end)
            if line.startswith(_REFUSALS):
                self._stale = False
                raise TransferAborted(
                    f"controller {self._node.number} refuses {command!r}: {line}; its firmware may not have it, or "
                    "not allow it now"
                )
            if one_line:
                if line == "OK":
                    continue  # left from before
                return [line]
            if line.startswith("OK"):
                return lines
            lines.append(line)

    def _line(self, command: str, end: float) -> str:
        while b"\n" not in self._text:
            if time.monotonic() > end:
                raise LinkTimeout(
                    f"controller {self._node.number} takes frames, but its console does not answer {command!r}"
                )
            more = self._poll()
            self._text += more
            if not more:
                time.sleep(_PAUSE)
        line, _, self._text = self._text.partition(b"\n")
        text = line.strip().decode("latin-1")
        return text or self._line(command, end)

    def _discard(self) -> None:
        """Waits until the console has nothing more to say from before."""
        quiet = time.monotonic() + _STALE
        while self._poll() or time.monotonic() < quiet:
            pass
        self._text = b""

    def _poll(self) -> bytes:
        flow = self._flow is not False
        reply = self._polled(flow)
        if flow and reply.packet is None:
            self._flow = False
            reply = self._polled(False)
        elif flow:
            self._flow, self._packet = True, reply.packet or 0
        return reply.stream or b""

    def _polled(self, flow: bool) -> Reply:
        data = stream_poll(_POLL_BYTES, self._packet if flow else None)
        if flow and self._flow is None:  # an older firmware answers with an empty frame
            return parse(self._node.request(data, lambda _: True))
        return parse(self._node.request(data, lambda answer: parse(answer).stream is not None))
