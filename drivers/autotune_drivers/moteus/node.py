"""One moteus controller at the end of a line: frames there and back, with what is wrong in words.

A frame is answered by `OK` (the adapter has it) and, where a reply is wanted, by the controller's frame.
Whose reply it is, the asker tells by its content. What was garbled on the way is asked for again; a line that loses
so much that the waiting adds up is given up, for whoever asks on such a line keeps its user waiting for minutes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

from autotune.core.errors import LinkError, LinkTimeout
from autotune_drivers.moteus.line import Line, encode
from autotune_drivers.moteus.multiplex import MODE, Form, Reply, parse, read
from autotune_drivers.moteus.port import MoteusPort

HOST = 0
_REPLY_WANTED = 0x80
_TRIES = 4
_TIMEOUT = 0.25
_GREETING = 0.15
_PATIENCE = 8.0  # s of waiting in vain, after which nothing is asked for again
_REFILLS = 0.1  # of the time that passes
_AFTER_GARBAGE = 0.01  # what was garbled may have been the `OK` alone
_LINE_TAKES = 0.02
_SCAN_EACH = 0.002
_SCAN_END = 0.1


class Heard(NamedTuple):
    """What came back: the reply (None: none in time), the adapter's refusal, whether lines were garbled."""

    reply: bytes | None
    accepted: bool
    refusal: str
    garbled: bool


class MoteusNode:
    """Talks to controller `number`. Methods raise LinkError where the port is gone."""

    def __init__(self, port: MoteusPort, number: int) -> None:
        self.port = port
        self.number = number
        self._identifier = _REPLY_WANTED << 8 | HOST << 8 | number
        self._answer = number << 8 | HOST
        self._checked = True
        self._vain = self._counted = 0.0
        self.be_patient()

    def be_patient(self) -> None:
        """What was waited for in vain until now is forgotten: what comes is to be tried in any case."""
        self._vain, self._counted = 0.0, time.monotonic()

    def _tries(self) -> int:
        """How often something may be sent now."""
        now = time.monotonic()
        self._vain = max(self._vain - _REFILLS * (now - self._counted), 0.0)
        self._counted = now
        return _TRIES if self._vain < _PATIENCE else 1

    @property
    def checked(self) -> bool:
        """Commands carry checksums."""
        return self._checked

    def send(self, data: bytes, reply: bool = True) -> None:
        """Sends a frame."""
        identifier = self._identifier if reply else self._identifier & 0x7FFF
        self.port.write(encode(identifier, data, self._checked))

    def listen(self, timeout: float, fits: Callable[[bytes], bool], reply: bool = True) -> Heard:
        """What follows on `send`; `fits` tells the wanted reply from others of this controller."""
        reader, before = self.port.reader, self.port.reader.garbled
        end = time.monotonic() + timeout
        accepted, refusal, garbled = False, "", False
        while True:
            left, received = end - time.monotonic(), reader.received
            lines = self.port.lines(min(left, _LINE_TAKES) if reader.unfinished else left)
            if reader.unfinished and reader.received == received and left > _LINE_TAKES:
                reader.give_up()  # its end is lost
            for line in lines:
                if line.kind == "OK":
                    accepted = True
                elif line.kind == "ERR":
                    refusal = line.text or "without a reason"
                elif self._is_mine(line) and fits(line.data):
                    return Heard(line.data, True, "", False)
            if not garbled and reader.garbled > before:
                garbled, end = True, min(end, time.monotonic() + _AFTER_GARBAGE)
            if refusal or (accepted and not reply) or time.monotonic() >= end:
                return Heard(None, accepted, refusal, garbled)

    def _is_mine(self, line: Line) -> bool:
        return line.identifier & 0x7F7F == self._answer

    # Requests at rest

    def request(self, data: bytes, fits: Callable[[bytes], bool], timeout: float = _TIMEOUT) -> bytes:
        """Sends a frame until its reply has come.

        Raises:
            LinkTimeout: no reply. LinkError: the adapter refuses the command.
        """
        heard = Heard(None, False, "", False)
        for _ in range(self._tries()):
            self.port.drain()
            self.send(data)
            began = time.monotonic()
            heard = self.listen(timeout, fits)
            if heard.reply is not None:
                return heard.reply
            self._vain += time.monotonic() - began
            self.note_refusal(heard.refusal)
        raise self.silence(heard)

    def tell(self, data: bytes, timeout: float = _TIMEOUT) -> int:
        """Sends a frame without a reply until the adapter has it; how often it was sent.

        Raises: as `request`.
        """
        heard = Heard(None, False, "", False)
        for sent in range(1, self._tries() + 1):
            self.send(data, reply=False)
            began = time.monotonic()
            heard = self.listen(timeout, lambda _: False, reply=False)
            if heard.accepted:
                return sent
            self._vain += time.monotonic() - began
            self.note_refusal(heard.refusal)
        raise self.silence(heard)

    def registers(self, *wanted: tuple[Form, int, int]) -> Mapping[int, float]:
        """Registers as (form, first, number); what the controller does not have is left out.

        Raises: as `request`.
        """
        asked = {number for _, first, count in wanted for number in range(first, first + count)}

        def fits(data: bytes) -> bool:
            reply = parse(data)
            return bool(reply.values or reply.errors) and {*reply.values, *reply.errors} <= asked

        data = b"".join(read(*entry) for entry in wanted)
        return parse(self.request(data, fits)).values

    def note_refusal(self, refusal: str) -> None:
        """Goes over to checksums where the line demands them."""
        if "checksum" in refusal.lower():
            self._checked = True

    # First words

    def greet(self) -> None:
        """Finds out whether the line has checksums, and that the controller is there.

        Raises:
            LinkTimeout: silence, garbage or another node's answer, each in its words.
        """
        heard = Heard(None, False, "", False)
        for checked in (True, False, True):
            self._checked = checked
            self.port.reader.forget()
            self.port.drain()
            self.send(read(Form.INT8, MODE))
            heard = self.listen(_GREETING, _has_mode)
            if heard.accepted or heard.reply is not None:
                break
        self._settle()
        if heard.reply is None:
            raise self.nobody(heard)

    def _settle(self) -> None:
        """An `OK` with a checksum to a command with one: from now on nothing else is believed."""
        self.port.drain()
        self.send(read(Form.INT8, MODE))
        end = time.monotonic() + _GREETING
        while time.monotonic() < end:
            for line in self.port.lines(end - time.monotonic()):
                if line.kind == "OK":
                    self._checked = self._checked and line.checked
                    self.port.reader.demands_checksums = line.checked
                    self.port.drain()
                    return

    def nobody(self, heard: Heard) -> LinkError:
        """Why there is no answer: nothing at all, garbage, a refusal, or other nodes only."""
        reader, name = self.port.reader, self.port.name
        if heard.refusal:
            return LinkError(
                f"the adapter at {name} refuses every command: {heard.refusal}. Is it an fdcanusb or a moteus's "
                "serial line? Look at it with a terminal: 'can status'"
            )
        if not reader.received:
            return LinkTimeout(
                f"nothing arrives on {name}: neither the adapter nor controller {self.number} answers. Check the "
                f"drive's power, the cable, that this is the right port, and on a serial line its speed "
                f"({self.port.baud} baud; another one is written into the link as &baud=115200)"
            )
        if not reader.understood:
            return LinkTimeout(
                f"{reader.received} bytes have come on {name}, but none of them makes sense: the line's speed is "
                f"not {self.port.baud} baud, or it is not an fdcanusb or moteus line. Write the right speed into "
                "the link as &baud=115200"
            )
        return self._only_others()

    def others(self) -> set[int]:
        """Asks every node for its mode: those that answer, but for this one."""
        found: set[int] = set()
        for number in range(1, 127):
            self.port.write(encode(_REPLY_WANTED << 8 | number, read(Form.INT8, MODE), self._checked))
            found |= self._sources(_SCAN_EACH)
        found |= self._sources(_SCAN_END)
        return found - {self.number}

    def _only_others(self) -> LinkError:
        found = self.others()
        if found:
            names = ", ".join(map(str, sorted(found)))
            return LinkTimeout(
                f"controller {self.number} does not answer on {self.port.name}, but {names} does; is the id in the "
                f"link wrong? Write id={min(found)} there, or set the controller's id.id"
            )
        return LinkTimeout(
            f"the adapter at {self.port.name} answers, but controller {self.number} is silent, and so is every "
            "other. Check the drive's power, the CAN cable and its termination at both ends"
        )

    def _sources(self, seconds: float) -> set[int]:
        end = time.monotonic() + seconds
        found: set[int] = set()
        while (left := end - time.monotonic()) > 0:
            found |= {line.identifier >> 8 & 0x7F for line in self.port.lines(left) if line.kind == "rcv"}
        return found

    def silence(self, heard: Heard) -> LinkError:
        """Why a controller that was there does not answer now."""
        if heard.refusal:
            return LinkError(
                f"the line {self.port.name} refuses a command {_TRIES} times in a row: {heard.refusal}. Check the "
                "cable and its shield; keep it away from motor cables"
            )
        if self._vain >= _PATIENCE:
            return LinkTimeout(
                f"the line {self.port.name} loses so much that {self._vain:.0f} s were waited for answers in vain, and "
                f"controller {self.number} was not asked again. Check the cable, the adapter and its driver"
            )
        what = "answered with garbled lines only" if heard.garbled else "does not answer"
        adapter = (
            "the adapter has taken the command" if heard.accepted else "nothing has confirmed the command"
        )
        return LinkTimeout(
            f"controller {self.number} on {self.port.name} {what}; {adapter}. Check its power and the cable"
        )


def _has_mode(data: bytes) -> bool:
    reply: Reply = parse(data)
    return set(reply.values) == {MODE}
