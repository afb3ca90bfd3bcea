"""A master that knows nothing of autotune, its cycle its own; a script of its own process.

It speaks raw slcan with an SDO client of its own, which is fast, or by PyPI's canopen over python-can (`--canopen`).
It configures the drive, enables the axis in cyclic position mode, and plays a sine. In lock-step it waits in each
cycle for the sidecar's frame, as long as that was there in the cycle before. At its end it writes what it saw:
an `.npz` with demand, position, offset (what acts in the drive) and the wall-clock time of each cycle.
"""

from __future__ import annotations

import argparse
import math
import os
import select
import struct
import sys
import threading
import time
import tty
from pathlib import Path

import canopen
import numpy as np

NODE = 5
COUNTS = 50000 / (2.0 * math.pi)
SIDECAR = 0x500 + NODE
CYCLE = 1e-3
WITHOUT, WITH = 1e-3, 0.2  # s that the master waits for a sidecar that was silent, and for one that was there


class Master:
    """One node on the bus, at an slcan adapter of its own."""

    def __init__(self, port: str) -> None:
        self.descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.descriptor)
        os.write(self.descriptor, b"C\rS8\rO\r")
        self.rest = b""
        self.frames: list[tuple[int, bytes]] = []
        self.accompanied = False
        self.pace = 0.0
        self.due = 0.0

    def send(self, cob_id: int, data: bytes = b"") -> None:
        os.write(self.descriptor, b"t%03X%d%s\r" % (cob_id, len(data), data.hex().upper().encode()))

    def take(self, cob_id: int, seconds: float) -> bytes | None:
        """The first frame with this COB-ID; the others stay."""
        end = time.monotonic() + seconds
        while True:
            for index, (identifier, data) in enumerate(self.frames):
                if identifier == cob_id:
                    del self.frames[index]
                    return data
            left = end - time.monotonic()
            if left <= 0.0 or not self.read(left):
                return None

    def read(self, seconds: float) -> bool:
        if not select.select([self.descriptor], [], [], seconds)[0]:
            return False
        *lines, self.rest = (self.rest + os.read(self.descriptor, 65536)).split(b"\r")
        for line in lines:
            line = line.lstrip(b"z\a")
            if line[:1] == b"t":
                self.frames.append((int(line[1:4], 16), bytes.fromhex(line[5:].decode())))
        return True

    def write(self, index: int, sub: int, code: str, value: float) -> None:
        """An expedited SDO download."""
        data = struct.pack("<" + code, value)
        command = 0x23 | (4 - len(data)) << 2
        self.send(0x600 + NODE, struct.pack("<BHB", command, index, sub) + data.ljust(4, b"\0"))
        answer = self.take(0x580 + NODE, 10.0)
        assert answer is not None, f"{index:04X}:{sub:02X} {answer!r}"
        assert answer[0] == 0x60, f"{index:04X}:{sub:02X} {answer!r}"

    def map(self, index: int, cob_id: int, entries: list[int]) -> None:
        self.write(index, 1, "I", 0x80000000 | cob_id)
        self.write(index + 0x200, 0, "B", 0)
        for sub, entry in enumerate(entries, 1):
            self.write(index + 0x200, sub, "I", entry)
        self.write(index + 0x200, 0, "B", len(entries))
        self.write(index, 2, "B", 1)
        self.write(index, 1, "I", cob_id)

    def configure(self) -> None:
        self.write(0x6060, 0, "b", 8)
        self.map(0x1400, 0x200 + NODE, [0x60400010, 0x607A0020])
        self.map(0x1800, 0x180 + NODE, [0x60620020, 0x60640020])
        self.map(0x1801, 0x280 + NODE, [0x22000520, 0x22000620])
        self.map(0x1802, 0x380 + NODE, [0x60410010])
        self.send(0, bytes((1, NODE)))

    def cycle(self, control: int, target: int) -> tuple[float, float, float, int]:
        """One cycle: demand and position [rad], offset of the host that acts [N m], status word."""
        self.frames.clear()
        self.send(0x200 + NODE, struct.pack("<Hi", control, target))
        if self.pace:
            self.due = max(self.due + self.pace, time.monotonic() - self.pace)
            self.take(-1, self.due - time.monotonic())
            self.accompanied = self.take(SIDECAR, 0.0) is not None
        else:
            self.accompanied = self.take(SIDECAR, WITH if self.accompanied else WITHOUT) is not None
        self.send(0x080)
        places, offsets, status = (self.take(base + NODE, 10.0) for base in (0x180, 0x280, 0x380))
        assert places is not None, "the drive is silent"
        assert offsets is not None, "the drive is silent"
        assert status is not None, "the drive is silent"
        demand, position = struct.unpack("<ii", places)
        total, own = struct.unpack("<ii", offsets)
        return demand / COUNTS, position / COUNTS, (total - own) * 1e-6, int.from_bytes(status, "little")

    def enable(self) -> int:
        """Axis under power, holding; where it is [counts]."""
        self.cycle(0x80, 0)
        where = round(self.cycle(0, 0)[1] * COUNTS)
        for word, wanted in ((0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)):
            for _ in range(100):
                if self.cycle(word, where)[3] & 0x6F == wanted:
                    break
            else:
                raise AssertionError(f"control word {word:#x} does not reach {wanted:#x}")
        return where


class CanopenMaster(Master):
    """The same by the canopen package: its SDO client, its PDO mapping, its NMT."""

    def __init__(self, port: str, eds: str) -> None:
        self.frames = []
        self.accompanied = False
        self.pace = self.due = 0.0
        self._heard = threading.Condition()
        self._network = canopen.Network()
        self._network.NOTIFIER_CYCLE = 0.05
        self._network.connect(interface="slcan", channel=port, bitrate=1_000_000, sleep_after_open=0)
        self._node = self._network.add_node(NODE, eds)
        self._node.sdo.RESPONSE_TIMEOUT = 10.0
        for cob_id in (SIDECAR, *(base + NODE for base in (0x180, 0x280, 0x380))):
            self._network.subscribe(cob_id, self._hear)

    def _hear(self, cob_id: int, data: bytes, _: float) -> None:
        with self._heard:
            self.frames.append((cob_id, bytes(data)))
            self._heard.notify()

    def send(self, cob_id: int, data: bytes = b"") -> None:
        self._network.send_message(cob_id, data)

    def take(self, cob_id: int, seconds: float) -> bytes | None:
        with self._heard:
            self._heard.wait_for(lambda: any(one == cob_id for one, _ in self.frames), max(seconds, 0.0))
            for index, (identifier, data) in enumerate(self.frames):
                if identifier == cob_id:
                    del self.frames[index]
                    return data
        return None

    def configure(self) -> None:
        node = self._node
        node.sdo[0x6060].raw = 8
        node.tpdo.read()
        node.rpdo.read()
        for pdo, mapped in (
            (node.rpdo[1], [(0x6040, 0), (0x607A, 0)]),
            (node.tpdo[1], [(0x6062, 0), (0x6064, 0)]),
            (node.tpdo[2], [(0x2200, 5), (0x2200, 6)]),
            (node.tpdo[3], [(0x6041, 0)]),
        ):
            pdo.clear()
            for index, sub in mapped:
                pdo.add_variable(index, sub)
            pdo.trans_type, pdo.enabled = 1, True
            pdo.save()
        node.nmt.state = "OPERATIONAL"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("port")
    parser.add_argument("out")
    parser.add_argument("--seconds", type=float, default=5.0, help="of the axis, once the sidecar is there")
    parser.add_argument("--go", default="", help="moves once this file is there, still until then")
    parser.add_argument("--until", default="", help="moves on until this file is there")
    parser.add_argument(
        "--pace", type=float, default=0.0, help="s between two SYNCs; 0: as the sidecar answers"
    )
    parser.add_argument("--canopen", default="", help="EDS file: speaks by the canopen package")
    options = parser.parse_args()
    master = CanopenMaster(options.port, options.canopen) if options.canopen else Master(options.port)
    master.configure()
    where = master.enable()
    sys.stdout.write("enabled\n")
    sys.stdout.flush()
    while options.go and not Path(options.go).exists():
        master.cycle(0x0F, where)
    rows = []
    k = missed = 0
    master.pace = options.pace
    while k < options.seconds / CYCLE or (options.until and not Path(options.until).exists()):
        t = k * CYCLE
        swell = min(t, 1.0) ** 2
        target = where + round(COUNTS * swell * 0.2 * math.sin(2.0 * math.pi * t))
        demand, position, offset, status = master.cycle(0x0F, target)
        rows.append((demand, position, offset, status, time.monotonic(), master.accompanied))
        k += 1
        missed += not master.accompanied
        if k % 100 == 0:
            sys.stdout.write(f"at {k} offset {offset:.4f} missed {missed}\n")
            sys.stdout.flush()
    names = ("demand", "position", "offset", "status", "wall", "accompanied")
    np.savez(options.out, **dict(zip(names, np.array(rows).T, strict=True)))
    sys.stdout.write("done\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
