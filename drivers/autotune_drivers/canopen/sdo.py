"""SDO transfers of one node: canopen's client, made synchronous and put behind one lock.

canopen's protocol code (expedited, segmented, block upload with CRC) runs on our own wire, in the
thread that waits, so no notifier thread competes with the cycle. It must not be called from a frame
handler: the answer would never be handled, and this is refused. Transfers that time out are repeated
as a whole; an abort (the drive's "no") is not.
"""

from __future__ import annotations

import struct
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TypeVar

from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import BlockUploadStream, SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from autotune.core.errors import LinkError, LinkTimeout, TransferAborted
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.wire import Wire

TIMEOUT = 0.5
SLOW_TIMEOUT = 5.0
_QUICK = (
    0.2  # s; a drive that has always answered far sooner is asked again after so long, but for the last time
)
_LONGER = 10.0  # times its slowest answer of late
_FORGETS = 0.95  # an answer: a host that was held up once is not slow for ever
_KNOWN = 20  # answers, from which on that is known
_SLOW = (0x1010, 0x1011)
_ATTEMPTS = 3
_LONGEST = 1_000_000  # bytes in segments of seven; longer ones come in blocks
_LATE = 0.02
_UPLOAD = struct.Struct("<BHB4x")
_KIND, _WRITE, _CONFIRMED = 0xE0, 0x20, 0x60  # of a request and an answer: initiate download
_ADVICE = {
    0x06010001: "it can only be written",
    0x06010002: "it can only be read",
    0x06020000: "this drive does not have it: check the profile",
    0x06090011: "this drive does not have it: check the profile",
    0x06090030: "choose a value inside the drive's range",
    0x06090031: "choose a smaller value",
    0x06090032: "choose a larger value",
    0x08000022: "not in this state: take power off first",
}

Value = TypeVar("Value")


class _Channel(SdoClient):  # type: ignore[misc]
    """canopen's SDO client with its request and response put on our wire.

    Attributes:
        answers, slowest: number of answers so far, and what the slowest of late took [s]; without those that may take
            longer than usual.
        strays: objects (index and sub-index as on the wire) whose writing was confirmed though nobody had asked for it.
    """

    def __init__(self, wire: Wire, node: int) -> None:
        super().__init__(0x600 + node, 0x580 + node, ObjectDictionary())
        self.timeout = TIMEOUT
        self.answers, self.slowest = 0, 0.0
        self._sent = 0.0
        self.strays: set[bytes] = set()
        self._written: set[bytes] = set()
        self._writes: bytes | None = None
        self._wire = wire
        self._inbox: deque[bytes] = deque()
        wire.on(0x580 + node, self._inbox.append)

    def forget(self) -> None:
        """Throws late answers away."""
        self._wire.drain()
        self._inbox.clear()

    def forget_answers(self) -> None:
        """Throws away what was answered to nobody."""
        self._inbox.clear()

    def next_answer(self) -> bytes | None:
        """The oldest answer that nobody has taken; None where there is none."""
        return self._inbox.popleft()[:8].ljust(8, b"\0") if self._inbox else None

    def await_answer(self, seconds: float) -> None:
        """Waits until something has been answered."""
        self._wire.wait(seconds, lambda: bool(self._inbox))

    def send_request(self, request: bytes) -> None:
        writes = request[0] & _KIND == _WRITE
        self._writes = bytes(request[1:4]) if writes else None
        if writes:
            self._written.add(bytes(request[1:4]))
        self._sent = time.monotonic()
        self._wire.send((self.rx_cobid, bytes(request)))

    def read_response(self) -> bytes:
        while True:
            if not self._wire.wait(self.timeout, lambda: bool(self._inbox)):
                raise SdoCommunicationError("no answer")
            response = self._inbox.popleft()
            if self.timeout <= TIMEOUT:
                self.answers += 1
                self.slowest = max(time.monotonic() - self._sent, _FORGETS * self.slowest)
            if len(response) != 8:
                raise SdoCommunicationError(f"an answer of {len(response)} bytes instead of 8")
            if response[0] == 0x80:
                raise SdoAbortedError(int.from_bytes(response[4:8], "little"))
            if not self._is_late(response):
                return response

    def _is_late(self, response: bytes) -> bool:
        """Whether it confirms an earlier write of ours, which a wire has doubled or held up.

        Raises:
            SdoCommunicationError: it confirms a write of an object that was never written: the request, or this
                answer, has changed on its way.
        """
        told = response[1:4]
        if self._writes is None or response[0] & _KIND != _CONFIRMED or told in (self._writes, b"\0\0\0"):
            return False
        if told not in self._written:
            self.strays.add(told)
            raise SdoCommunicationError(f"{_object(told)} was confirmed instead")
        return True

    def abort(self, abort_code: int = 0x08000000) -> None:
        self.send_request(struct.pack("<BxxxL", 0x80, abort_code))

    def request_response(self, sdo_request: bytes) -> bytes:
        self.send_request(sdo_request)
        return self.read_response()


def _object(place: bytes) -> str:
    return f"object {int.from_bytes(place[:2], 'little'):04X}h:{place[2]:02X}"


class _BlockUpload(BlockUploadStream):  # type: ignore[misc]
    """canopen calls `abort` on the stream where it means the client."""

    def abort(self, code: int) -> None:
        self.sdo_client.abort(code)


class Sdo:
    """Reads and writes objects of one node. SI and names are the caller's."""

    def __init__(self, wire: Wire, node: int) -> None:
        self.node = node
        self._channel = _Channel(wire, node)
        self._lock = threading.Lock()
        self._owner = 0
        self._asked = False

    def read(self, ref: ObjectRef, attempts: int = _ATTEMPTS) -> Raw:
        """The object's value.

        Raises:
            TransferAborted: the drive refuses. LinkTimeout: no answer. LinkError: not its type, each time.
        """
        for left in reversed(range(attempts)):
            data = self.read_bytes(ref, attempts)
            if len(data) >= ref.size or not left:
                break
        return ref.decode(data)

    def read_bytes(self, ref: ObjectRef, attempts: int = _ATTEMPTS) -> bytes:
        """The object's bytes (expedited or segmented)."""
        return self._transfer("read", ref, lambda: self._upload(ref), attempts)

    def _upload(self, ref: ObjectRef) -> bytes:
        """As many bytes as the node announces; an object longer than any recording is none."""
        data = b""
        with self._channel.open(ref.index, ref.sub, buffering=0) as stream:
            while part := stream.read(7):
                data += part
                if len(data) > _LONGEST:
                    raise SdoCommunicationError(f"more than {_LONGEST} bytes")
            size = stream.size
        if size is not None and size != len(data):
            raise SdoCommunicationError(f"{len(data)} bytes instead of the {size} announced")
        return data

    def read_block(self, ref: ObjectRef) -> bytes:
        """A long object by block upload, checked by CRC; segmented where the drive has no block upload."""

        def upload() -> bytes:
            with _BlockUpload(self._channel, ref.index, ref.sub) as stream:
                return bytes(stream.readall())

        try:
            return self._transfer("read", ref, upload, _ATTEMPTS)
        except TransferAborted as error:
            if error.code != 0x05040001:
                raise
            return self.read_bytes(ref)

    def write(self, ref: ObjectRef, raw: Raw, timeout: float | None = None) -> None:
        """Writes the object; `timeout` seconds for an answer where the usual ones are too short.

        Raises:
            TransferAborted: the drive refuses. LinkTimeout: no answer.
        """
        data = ref.encode(raw)

        def download() -> None:
            self._channel.download(ref.index, ref.sub, data)

        self._transfer("write", ref, download, _ATTEMPTS, timeout)

    def strays(self) -> list[str]:
        """Objects that the drive may have written by mistake, in words: frames that changed on an unprotected wire."""
        return [
            f"{_object(one)} may have been written by a frame that changed on its way; compare it with what it was"
            for one in sorted(self._channel.strays)
        ]

    def ask(self, ref: ObjectRef) -> None:
        """Asks for an object of at most 4 bytes without waiting; see `answer`. Raises LinkError."""
        self._channel.forget_answers()
        self._asked = True
        self._channel.send_request(_UPLOAD.pack(0x40, ref.index, ref.sub))

    def answer(self, ref: ObjectRef) -> bytes | None:
        """What `ask` was answered: the object's bytes, none where the drive refuses; None: not yet."""
        while (response := self._channel.next_answer()) is not None:
            command, index, sub = _UPLOAD.unpack(response)
            if (index, sub) != (ref.index, ref.sub):
                continue
            self._asked = False
            expedited = command & 0xE3 == 0x43
            size = 4 - (command >> 2 & 3)
            return response[4 : 4 + size] if expedited and size == ref.size else b""
        return None

    def _transfer(
        self,
        verb: str,
        ref: ObjectRef,
        call: Callable[[], Value],
        attempts: int,
        timeout: float | None = None,
    ) -> Value:
        if self._owner == threading.get_ident():
            raise LinkError(f"{ref} was asked for from inside another transfer; wait until that has ended")
        with self._lock:
            self._owner = threading.get_ident()
            try:
                if self._asked:  # its answer must not be taken for ours
                    self._asked = False
                    self._channel.await_answer(_LATE)
                usual = SLOW_TIMEOUT if ref.index in _SLOW else TIMEOUT
                self._channel.timeout = usual if timeout is None else timeout
                return self._attempts(verb, ref, call, attempts)
            finally:
                self._owner = 0

    def _attempts(self, verb: str, ref: ObjectRef, call: Callable[[], Value], attempts: int) -> Value:
        longest = self._channel.timeout
        for attempt in range(1, attempts + 1):
            self._channel.timeout = longest if attempt == attempts else self._soon(longest)
            self._channel.forget()
            try:
                return call()
            except SdoAbortedError as error:
                raise self._refused(verb, ref, error) from None
            except SdoCommunicationError as error:
                self._channel.abort(0x05040000)
                if attempt == attempts:
                    raise LinkTimeout(
                        f"node {self.node} did not let {verb} {ref}: {error} within "
                        f"{self._channel.timeout:g} s, {attempts} times. Check power, cable and node number"
                    ) from error
        raise LinkTimeout(f"node {self.node}: no attempt was made to {verb} {ref}")

    def _soon(self, longest: float) -> float:
        """How long an answer may take before it is asked for again: a wire that loses a frame loses more of them.

        What is known to take long, as storing does, is never hurried.
        """
        channel = self._channel
        if channel.answers < _KNOWN or longest > TIMEOUT:
            return longest
        return min(longest, max(_QUICK, _LONGER * channel.slowest))

    def _refused(self, verb: str, ref: ObjectRef, error: SdoAbortedError) -> TransferAborted:
        text = SdoAbortedError.CODES.get(error.code, "a reason of the vendor's own")
        advice = _ADVICE.get(error.code, "see the drive's manual")
        return TransferAborted(
            f"node {self.node} refuses to {verb} {ref}: {text} (abort code {error.code:08X}h); {advice}",
            error.code,
        )
