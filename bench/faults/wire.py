"""Cases behind a wire: the drive, the proxy and the program are processes of their own.

A case is drawn from its seed; which message or instruction it hits depends on the scheduler too, so that a
second run of the same seed is the same case, not the same instant.
"""

from __future__ import annotations

import faulthandler
import os
import shutil
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from autotune_sim.truth import Event, TruthFile, powered
from bench.faults.axis_file import command, write_axis
from bench.faults.cases import PREPARED, Case
from bench.faults.child import Child, program, start
from bench.faults.evidence import Ending, Evidence, different
from bench.faults.here import TEMPLATE_PLANT, read_log
from bench.faults.policy import LAST, POLICY
from bench.faults.proxy import Operation, Proxy

PATIENCE = 60.0  # s without any work and without power, of the rig for a case
_START = 120.0  # s for the program to reach the case's time
_LOOK = 0.01
_BURSTS = 12
_LINKS = {
    "wire": ("canopen", "canopen+slcan:{port}?bitrate=1000000&node=5", "autotune-sim", 5),
    "line": ("moteus", "moteus+serial:{port}?id=1", "autotune-sim-moteus", 1),
}


@dataclass
class Rig:
    """The drive's process, and the way to tell it something."""

    folder: Path
    drive: Child
    orders: int

    def order(self, text: str) -> None:
        """Tells the drive's process a fault order."""
        with suppress(OSError):
            os.write(self.orders, text.encode() + b"\n")

    def snapshot(self) -> TruthFile:
        """The log until now, with the objects as they are now as its `closed`; `stalled`: the drive's process hangs."""
        count = len(self._events())
        self.order("snapshot")
        told = _wait(lambda: len(self._events()) > count, 2.0)
        log = read_log(self.folder / "truth")
        last = next((event for event in reversed(log.events) if event.kind == "objects"), None)
        events = tuple(event for event in log.events if event.kind != "objects")
        if last is not None:
            events += (Event("closed", last.time, last.wall, last.details),)
        if not told:
            at = float(log.rows["time"][-1]) if len(log.rows) else 0.0
            events += (Event("stalled", at, time.monotonic(), {"where": self._where()}),)
        return TruthFile(log.rows, events)

    def _where(self) -> str:
        """What the drive's process does, as the kernel and its own stack tell it."""
        process = Path(f"/proc/{self.drive.pid}")
        with suppress(OSError, IndexError):
            state = (process / "stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
            waits = (process / "wchan").read_text(encoding="ascii")
            length = self.drive.output.stat().st_size
            os.kill(self.drive.pid, signal.SIGUSR1)
            _wait(lambda: self.drive.output.stat().st_size > length, 1.0)
            with self.drive.output.open("rb") as file:
                file.seek(length)
                stack = file.read().decode("utf-8", "replace")
            return f"state {state}, waits in {waits or 'nothing'}; {' < '.join(stack.split(chr(10))[1:6])}"
        return "it is gone"

    def _events(self) -> list[Event]:
        return [event for event in read_log(self.folder / "truth").events if event.kind == "objects"]

    def close(self) -> None:
        """Ends the drive's process."""
        with suppress(OSError):
            os.close(self.orders)
        with suppress(ProcessLookupError):
            os.kill(self.drive.pid, signal.SIGCONT)
        self.drive.wait(5.0)


def run_wire(case: Case, folder: Path, template: Path | None) -> Evidence:
    """Plays the case; a second start follows where settings are left."""
    if case.programme in PREPARED and template is not None:
        shutil.copytree(template / "runs", folder / "runs")
        case = replace(case, plant=TEMPLATE_PLANT)
    link, url, profile, number = _LINKS[case.kind]
    proxied = bool(case.proxy)
    port = folder / ("drive.tty" if proxied else "axis.tty")
    write_axis(case, folder, url.format(port=folder / "axis.tty"), profile)
    rig = _start_drive(case, folder, link, number, port)
    others: list[Child] = []
    try:
        if proxied:
            others.append(_start_proxy(case, folder, port))
        child = _start_program(case, folder, "out.txt")
        put_in = _happen(case, rig, child)
        ending = child.wait(PATIENCE, _kills(case), lambda: _at_work(folder / "truth"))
        _mourn(ending, folder)
        log = _with_host_events(case, rig.snapshot(), put_in, folder)
        evidence = Evidence(case, ending, log, missed=_missed(folder))
        return _second_start(evidence, rig, folder, others)
    finally:
        for other in others:
            other.kill()
            other.wait(2.0)
        rig.close()
        _sweep(folder)


def _start_drive(case: Case, folder: Path, link: str, number: int, port: Path) -> Rig:
    read, write = os.pipe()

    def work() -> None:
        from autotune_sim.server import serve

        os.dup2(read, 0)
        os.close(write)
        faulthandler.register(signal.SIGUSR1)
        serve(
            "edm-vertical",
            port,
            number,
            seed=case.plant,
            link=link,
            faults=case.orders,
            state_file=folder / "mem",
            commands=True,
            truth=folder / "truth",
            counts=case.counts,
            log=lambda text: print(text, flush=True),
        )

    drive = start(work, folder / "drive.log")
    os.close(read)
    _wait(port.is_symlink, 20.0)
    return Rig(folder, drive, write)


def _start_proxy(case: Case, folder: Path, port: Path) -> Child:
    operation = Operation.parse(case.proxy[0])
    host = folder / "axis.tty"
    proxy = start(
        lambda: Proxy(host, port, case.kind, operation, case.seed, folder / "touched").run(),
        folder / "proxy.log",
    )
    _wait(host.is_symlink, 5.0)
    return proxy


def _start_program(case: Case, folder: Path, output: str) -> Child:
    def work() -> None:
        os.chdir(folder)
        program(command(case, folder))

    return start(work, folder / output)


# What happens to processes


def _kills(case: Case) -> bool:
    return case.host is not None and case.host[1] in ("kill-owner", "kill-both", "stop-owner")


def _happen(case: Case, rig: Rig, child: Child) -> Event | None:
    """Waits for the case's time and does to the processes what it says."""
    if case.host is None:
        return None
    _, which, when = case.host
    truth = rig.folder / "truth"
    _wait(lambda: not child.running or _enabled_time(truth) >= when, _START, 0.05)
    if not child.running:
        return None
    rows = read_log(truth).rows
    event = Event(
        "fault put in", float(rows["time"][-1]) if len(rows) else 0.0, time.monotonic(), {"name": which}
    )
    _hit(which, child.pid, _children(child.pid), rig.drive.pid, child)
    return event


def _hit(which: str, owner: int, cyclic: list[int], drive: int, child: Child) -> None:
    if which == "stop-child":
        _signal(cyclic, signal.SIGSTOP)
    elif which == "stop-owner":
        _signal([owner], signal.SIGSTOP)
        time.sleep(10.0)
        _signal([owner], signal.SIGKILL)
    elif which == "stop-drive":
        _signal([drive], signal.SIGSTOP)
        _wait(lambda: not child.running, POLICY.end)
        _signal([drive], signal.SIGCONT)
    elif which in ("kill-child", "kill-owner", "kill-both"):
        pids = cyclic if which == "kill-child" else [owner] if which == "kill-owner" else [*cyclic, owner]
        _signal(pids, signal.SIGKILL)
    elif which == "suspend":
        _signal([*cyclic, owner], signal.SIGSTOP)
        time.sleep(3.0)
        _signal([*cyclic, owner], signal.SIGCONT)
    elif which.startswith("starve"):
        _starve(cyclic if which == "starve-child" else [owner])
    else:
        _signal([owner], signal.SIGTERM if which == "term-owner" else signal.SIGINT)


def _starve(pids: list[int]) -> None:
    """A loaded machine: stopped for up to 0.3 s, again and again."""
    for burst in range(_BURSTS):
        _signal(pids, signal.SIGSTOP)
        time.sleep(0.01 + 0.29 * burst / _BURSTS)
        _signal(pids, signal.SIGCONT)
        time.sleep(0.05)


def _signal(pids: list[int], number: int) -> None:
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, number)


def _children(pid: int) -> list[int]:
    with suppress(OSError):
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []


def _at_work(truth: Path) -> bool:
    """The cyclic process moves the axis, while the program waits for it."""
    with suppress(OSError, ValueError):
        return powered(truth)
    return False


def _enabled_time(truth: Path) -> float:
    rows = read_log(truth).rows
    return float(np.count_nonzero(rows["mode"] >= 0)) * 1e-3


# Afterwards


def _mourn(ending: Ending, folder: Path) -> None:
    """Waits for the drive to take power off by itself, where nobody is left to do it."""

    def off() -> bool:
        rows = read_log(folder / "truth").rows[-LAST:]
        still = np.all(np.abs(rows["velocity"]) < POLICY.rest)
        return len(rows) == 0 or bool(np.all(rows["mode"] < 0) and still)

    if ending.code in (0, 2, 3, 4, 130):
        _wait(off, 0.2)  # the last periods without power take the simulated drive a moment
        return

    _wait(off, POLICY.power_off)


def _with_host_events(case: Case, log: TruthFile, put_in: Event | None, folder: Path) -> TruthFile:
    """The log with what happened outside of the drive."""
    events = list(log.events)
    if put_in is not None:
        events.append(put_in)
    if case.counts is not None:
        events.insert(0, Event("fault put in", 0.0, events[0].wall, {"name": "encoder-counts"}))
    with suppress(OSError, ValueError):
        wall = float((folder / "touched").read_text())
        rows = log.rows
        place = min(int(np.searchsorted(rows["wall"], wall)), max(len(rows) - 1, 0))
        at = float(rows["time"][place]) if len(rows) else 0.0
        events.append(Event("fault put in", at, wall, {"name": "proxy"}))
    return TruthFile(log.rows, tuple(sorted(events, key=lambda event: event.wall)))


def _missed(folder: Path) -> int:
    """Cycles that the recordings of a run tell as lost; one that was cut off tells none."""
    count = 0
    for path in folder.rglob("*.parquet"):
        with suppress(OSError, ValueError, KeyError):
            count += int(np.sum(pq.read_table(path, columns=["missed"])["missed"].to_numpy()))
    return count


def _second_start(evidence: Evidence, rig: Rig, folder: Path, others: list[Child]) -> Evidence:
    """Where settings are left: the cause is gone, somebody resets the drive, and the program starts again."""
    before, after = evidence.settings("open"), evidence.settings("closed")
    if before is None or after is None or not different(before, after) or evidence.ending.code == 0:
        return evidence
    if not rig.drive.running:
        return evidence
    if evidence.case.proxy:
        _bypass(folder, others)
    for order in ("clear", "fault-reset"):
        rig.order(order)
    time.sleep(0.7)
    again = _start_program(replace(evidence.case, programme="run --only check"), folder, "out-2.txt").wait(
        40.0
    )
    now = replace(evidence, truth=rig.snapshot())
    spent = replace(evidence.ending, cpu=evidence.ending.cpu + again.cpu)
    return replace(evidence, ending=spent, put_right=now.settings("closed"), next_words=again.words)


def _bypass(folder: Path, others: list[Child]) -> None:
    """The wire is whole again: the host's port is the drive's."""
    while others:
        proxy = others.pop()
        proxy.kill()
        proxy.wait(2.0)
    (folder / "axis.tty").unlink(missing_ok=True)
    (folder / "axis.tty").symlink_to(os.readlink(folder / "drive.tty"))


def _sweep(folder: Path) -> None:
    """Ends what is left of the program: cyclic processes that were stopped."""
    mark = str(folder).encode()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        with suppress(OSError):
            if os.readlink(entry / "cwd").encode().startswith(mark):
                os.kill(int(entry.name), signal.SIGKILL)


def _wait(seen: Callable[[], bool], seconds: float, pause: float = _LOOK) -> bool:
    end = time.monotonic() + seconds
    while not seen():
        if time.monotonic() > end:
            return False
        time.sleep(pause)
    return True
