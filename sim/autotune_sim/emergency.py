"""Error register, error history and EMCY messages (CiA 301, 7.2.7; error codes of CiA 402)."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from enum import IntEnum

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.object_dictionary import ObjectDictionary, Value

HISTORY = 8
_FRAME = struct.Struct("<HB5s")
_INVALID = 0x80000000


class ErrorCode(IntEnum):
    """Error codes that this drive can raise by itself."""

    NONE = 0x0000
    MOTOR_TEMPERATURE = 0x4310
    SPEED = 0x7310
    PDO_LENGTH = 0x8210
    SYNC_LENGTH = 0x8240
    HEARTBEAT = 0x8130
    FOLLOWING_ERROR = 0x8611
    POSITION_LIMIT = 0x8612
    ENABLE_INPUT = 0xFF10
    BRAKE = 0xFF11


def register_bit(code: int) -> int:
    """Bit of the error register (1001) for an error code, besides the generic one."""
    if code >= 0xFF00:
        return 0x80
    if code & 0xF000 == 0x8000:
        return 0x10 if code < 0x8400 else 0x20
    return {2: 0x02, 3: 0x04, 4: 0x08, 7: 0x20}.get(code >> 12, 0)


class Emergency:
    """Keeps errors and tells the master of them through `send(cob_id, data)`."""

    def __init__(self, objects: ObjectDictionary, send: Callable[[int, bytes], None]) -> None:
        self._objects = objects
        self._send = send
        self._present: list[int] = []
        self._history: deque[int] = deque(maxlen=HISTORY)
        self._cob_id = objects[0x1014]
        self._inhibit = objects[0x1015]
        self._waiting: deque[bytes] = deque(maxlen=HISTORY)
        self._free_at = -1e9
        objects[0x1001].read = lambda: self.register
        objects[0x1003, 0].read = lambda: len(self._history)
        objects[0x1003, 0].write = self._clear_history
        for number in range(1, HISTORY + 1):
            objects[0x1003, number].read = self._reader(number - 1)

    @property
    def register(self) -> int:
        """Object 1001."""
        value = 1 if self._present else 0
        for code in self._present:
            value |= register_bit(code)
        return value

    def reset(self) -> None:
        """Forgets everything, as at power-up."""
        self._present.clear()
        self._history.clear()
        self._waiting.clear()

    def report(self, code: int, detail: int = 0, lasting: bool = True) -> None:
        """An error has appeared; `lasting` ones stay in the register until `clear`."""
        if lasting and code not in self._present:
            self._present.append(code)
        self._history.appendleft(detail << 16 | code)
        self._waiting.append(_FRAME.pack(code, self.register, detail.to_bytes(2, "little")))

    def clear(self) -> None:
        """All errors are gone (fault reset)."""
        if self._present:
            self._present.clear()
            self._waiting.append(_FRAME.pack(0, 0, b""))

    def poll(self, now: float, allowed: bool) -> float | None:
        """Sends what waits, the inhibit time (1015) apart; when to call again [s], or None."""
        if not allowed or int(self._cob_id.value) & _INVALID:
            self._waiting.clear()
        pause = int(self._inhibit.value) * 1e-4
        while self._waiting and now >= self._free_at:
            self._send(int(self._cob_id.value) & 0x7FF, self._waiting.popleft())
            self._free_at = now + pause
        return self._free_at if self._waiting else None

    @property
    def waiting(self) -> bool:
        return bool(self._waiting)

    def _reader(self, position: int) -> Callable[[], Value]:
        def read() -> Value:
            if position >= len(self._history):
                raise Abort(AbortCode.NO_DATA)
            return self._history[position]

        return read

    def _clear_history(self, value: Value) -> None:
        if value != 0:
            raise Abort(AbortCode.RANGE)
        self._history.clear()
