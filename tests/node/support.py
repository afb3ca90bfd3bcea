"""A simulated drive on a bench: its bus is a list of frames, its clock a number."""

from __future__ import annotations

import os
import select
import struct
import time
from pathlib import Path

from autotune.core.paths import config_directory
from autotune_sim.device import Device
from autotune_sim.memory import Memory
from autotune_sim.presets import preset
from autotune_sim.servo import Servo
from tests.support.forked import PIPE, SIMULATOR, STDOUT, Program

EDS = config_directory() / "eds" / "autotune-sim.eds"
NODE = 5
CSP, CSV, CST = 8, 9, 10


class Refused(Exception):
    """An SDO abort."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code:08X}")
        self.code = code


class Bench:
    """A device without a wire; `now` is its wall clock."""

    def __init__(self, memory: Memory | None = None, *, real_time: bool = False, seed: int = 0) -> None:
        self.now = 100.0
        self.frames: list[tuple[int, bytes]] = []
        self.log: list[str] = []
        self.memory = memory if memory is not None else Memory(None, self.log.append)
        servo = Servo(preset("edm-vertical", seed=seed), seed)
        self.device = Device(servo, EDS, NODE, self._send, self.memory, self.log.append, real_time=real_time)
        self.device.poll(self.now)

    def _send(self, cob_id: int, data: bytes) -> None:
        self.frames.append((cob_id, data))

    def take(self, cob_id: int) -> list[bytes]:
        """Frames of one COB-ID since the last call, removed."""
        found = [data for identifier, data in self.frames if identifier == cob_id]
        self.frames = [frame for frame in self.frames if frame[0] != cob_id]
        return found

    def send(self, cob_id: int, data: bytes = b"") -> None:
        self.device.receive(cob_id, data, self.now)

    def wait(self, seconds: float, step: float = 1e-3) -> None:
        """Lets the wall clock run."""
        end = self.now + seconds
        while self.now < end:
            self.now += step
            self.device.poll(self.now)
            due = self.device.heartbeat_due
            if due is not None and self.now >= due:
                self.device.check_heartbeats(self.now)

    def nmt(self, command: int) -> None:
        self.send(0, bytes((command, NODE)))

    def request(self, data: bytes) -> bytes:
        """One SDO request and its answer."""
        self.take(0x580 + NODE)
        self.send(0x600 + NODE, data.ljust(8, b"\0"))
        (answer,) = self.take(0x580 + NODE)
        if answer[0] == 0x80:
            raise Refused(struct.unpack_from("<I", answer, 4)[0])
        return answer

    def upload(self, index: int, subindex: int = 0) -> bytes:
        answer = self.request(struct.pack("<BHB", 0x40, index, subindex))
        if answer[0] & 2:
            return answer[4 : 8 - (answer[0] >> 2 & 3)]
        content, toggle = b"", 0
        while True:
            part = self.request(bytes((0x60 | toggle,)))
            content += part[1 : 8 - (part[0] >> 1 & 7)]
            toggle ^= 0x10
            if part[0] & 1:
                return content

    def download(self, index: int, subindex: int, data: bytes) -> None:
        command = 0x23 | (4 - len(data)) << 2
        self.request(struct.pack("<BHB", command, index, subindex) + data)

    def get(self, index: int, subindex: int = 0) -> float:
        entry = self.device.objects[index, subindex]
        assert entry.packer is not None
        return float(entry.packer.unpack(self.upload(index, subindex))[0])

    def put(self, index: int, subindex: int, value: float) -> None:
        entry = self.device.objects[index, subindex]
        self.download(index, subindex, entry.encode(value))

    def map(self, communication: int, cob_id: int, mapping: list[int], kind: int = 1) -> None:
        """Sets a PDO up in the order that drives demand."""
        parameters = communication + 0x200
        self.put(communication, 1, cob_id | 0x80000000)
        self.put(communication, 2, kind)
        self.put(parameters, 0, 0)
        for number, entry in enumerate(mapping, 1):
            self.put(parameters, number, entry)
        self.put(parameters, 0, len(mapping))
        self.put(communication, 1, cob_id)

    def prepare(self, mode: int = CSP) -> None:
        """Maps controlword, targets and offset; status, position and counter; goes operational."""
        self.map(0x1400, 0x205, [0x60400010, 0x607A0020])
        self.map(0x1401, 0x305, [0x22000320, 0x22000420])
        self.map(0x1402, 0x405, [0x60FF0020])
        self.map(0x1800, 0x185, [0x60410010, 0x60640020, 0x22100410])
        self.map(0x1801, 0x285, [0x22000120, 0x22000220])
        self.put(0x6060, 0, mode)
        self.nmt(1)

    def cycle(
        self, controlword: int, position: int = 0, offset: int = 0, torque: int = 0, velocity: int = 0
    ) -> tuple[int, int, int]:
        """One SYNC; status word, position and SYNC counter."""
        self.now += 1e-3
        self.send(0x205, struct.pack("<Hi", controlword, position))
        self.send(0x305, struct.pack("<ii", offset, torque))
        self.send(0x405, struct.pack("<i", velocity))
        self.take(0x185)
        self.send(0x080)
        self.device.poll(self.now)
        (frame,) = self.take(0x185)
        word, actual, count = struct.unpack("<HiH", frame)
        return word, actual, count

    def enable(self, mode: int = CSP) -> int:
        """Brings the drive to operation enabled; the position there."""
        self.prepare(mode)
        position = self.cycle(0)[1]
        for controlword, wanted in ((6, 0x21), (7, 0x23), (15, 0x27)):
            word, position, _ = self.cycle(controlword, position)
            assert word & 0x6F == wanted
        return position

    @property
    def word(self) -> int:
        """The state's bits of the status word."""
        word = self.device.firmware.statusword()
        return word & (0x6F if word & 0x20 else 0x4F)


class Simulator:
    """`python -m autotune_sim` as a process; it ends with its standard input, whatever happens to us."""

    def __init__(self, port: Path, *options: str) -> None:
        self.port = port
        self.lines: list[str] = []
        self.process = Program(
            SIMULATOR, str(port), "--commands", *options, stdin=PIPE, stdout=PIPE, stderr=STDOUT
        )
        self._rest = b""

    def expect(self, text: str, timeout: float = 60.0) -> str:
        """Waits for a line of the log that contains `text`; the line."""
        seen = 0
        deadline = time.monotonic() + timeout
        while True:
            for line in self.lines[seen:]:
                if text in line:
                    return line
            seen = len(self.lines)
            assert self._read(deadline), f"no {text!r} in {self.lines}"

    def _read(self, deadline: float) -> bool:
        assert self.process.stdout is not None
        left = deadline - time.monotonic()
        if left <= 0 or not select.select([self.process.stdout], [], [], left)[0]:
            return False
        data = os.read(self.process.stdout.fileno(), 65536)
        *lines, self._rest = (self._rest + data).split(b"\n")
        self.lines += [line.decode() for line in lines]
        return bool(data)

    def command(self, text: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()

    def close(self) -> int:
        """Ends the process; its exit code."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        if self.process.poll() is None:
            self.process.terminate()
        code = self.process.wait(20)
        self.process.stdin.close()
        self.process.stdout.close()
        return code
