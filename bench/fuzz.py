"""Hostile inputs to everything that reads: `python -m bench.fuzz --inputs 1000000 --seed 1`.

Every input is made from its kind, the seed and its number alone, so that a finding can be seen again with
`--kind KIND --only NUMBER`. Two forked workers read; the parent watches. A finding is: another exception
than an AutotuneError, a message that nobody can read, more than 10 s of processor time, 500 MB more memory,
a dead worker, or something accepted that the judge of the kind (`fuzz_judging`) says cannot be.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from bench.fuzz_judging import Found, Kind, corpus
from bench.fuzz_kinds import KINDS

LONGEST, MOST_MEMORY = 10.0, 500_000_000
WORKERS = 2
SHARED_MEMORY = "/dev/shm"  # noqa: S108 - a folder of random name is made in it
PATIENCE = 60.0
"""Of the parent [s]: a worker that sleeps, or is held outside Python, is ended."""
_BLOCK = 64
_SHOWN = 400


class TooLong(BaseException):
    """The time of one input is over; no handler of errors may swallow it."""


@dataclass(slots=True)
class Tally:
    """What came of the inputs of a kind."""

    inputs: int = 0
    accepted: int = 0
    seconds: float = 0.0


@dataclass(slots=True)
class Result:
    """Tallies by kind; findings by (kind, what, where), with how often and the first input's number."""

    tallies: dict[str, Tally] = field(default_factory=dict)
    findings: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    first: dict[tuple[str, str, str], int] = field(default_factory=dict)
    memory: int = 0

    def note(self, kind: str, number: int, what: str, where: str) -> None:
        self.findings[kind, what, where] += 1
        self.first.setdefault((kind, what, where), number)


def input_of(kind: Kind, seed: int, number: int, seeds: list[bytes]) -> bytes:
    """The input of that number."""
    return kind.make(random.Random(f"{seed} {kind.name} {number}"), seeds)


def judge(kind: Kind, seed: int, number: int, seeds: list[bytes], folder: Path) -> tuple[bool, str, str]:
    """Whether the input of that number was accepted; what was found ("" for nothing), and where."""
    try:
        data = input_of(kind, seed, number, seeds)
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
        return kind.run(data, folder), "", ""
    except Found as finding:
        return False, "judged", str(finding)[:_SHOWN]
    except TooLong:
        return False, "too long", _where()
    except Exception as error:  # noqa: BLE001 - a crash is what is looked for
        return False, type(error).__name__, f"{_where()}: {error}"[:_SHOWN]
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _where() -> str:
    frames = traceback.extract_tb(sys.exc_info()[2])
    own = [one for one in frames if "autotune" in one.filename and "bench" not in one.filename]
    last = (own or frames)[-1]
    return f"{Path(last.filename).name}:{last.lineno}"


def _ring(number: int, frame: FrameType | None) -> None:
    raise TooLong


def work(blocks: list[tuple[int, int, int]], seed: int, folder: Path, pipe: Any, place: Any) -> None:
    """Reads blocks (kind, first number, how many); notes in `place` where it is, for the parent to see."""
    signal.signal(signal.SIGPROF, _ring)
    warnings.simplefilter("error")
    seeds = {kind.name: corpus(kind.name) for kind in KINDS}
    used = {index for index, _, _ in blocks}
    for kind in (KINDS[index] for index in used):  # what is loaded on first use is no input's time
        kind.run(seeds[kind.name][0], folder)
        place[2] = int(time.monotonic())
    for block, (index, first, count) in enumerate(blocks):
        kind, accepted, findings = KINDS[index], 0, []
        begun = time.process_time()
        for number in range(first, first + count):
            place[0], place[1], place[2] = index, number, int(time.monotonic())
            before = _memory()
            good, what, where = judge(kind, seed, number, seeds[kind.name], folder)
            accepted += good
            if what:
                findings.append((number, what, where.replace(str(folder), "")))
            if _memory() - before > MOST_MEMORY:
                findings.append((number, "memory", f"{(_memory() - before) / 1e6:.0f} MB"))
        pipe.send((block, index, count, accepted, time.process_time() - begun, findings, _memory()))
    pipe.send(None)


def _memory() -> int:
    """The most that this process has had [bytes]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


class Worker:
    """A forked process with its blocks; a dead or hanging one is replaced and goes on behind the input."""

    def __init__(self, blocks: list[tuple[int, int, int]], seed: int, folder: Path) -> None:
        self.blocks, self.seed, self.folder = blocks, seed, folder
        self.done = False
        self._start()

    def _start(self) -> None:
        self.pipe, child = multiprocessing.Pipe(duplex=False)
        self.place = multiprocessing.Array("q", [0, -1, int(time.monotonic())], lock=False)
        arguments = (self.blocks, self.seed, self.folder, child, self.place)
        self.process = multiprocessing.get_context("fork").Process(target=work, args=arguments, daemon=True)
        self.process.start()
        child.close()
        self.read = 0

    def look(self, result: Result) -> None:
        """Takes what has come; replaces a worker that died or hangs beyond its own alarm."""
        try:
            while self.pipe.poll(0.0):
                message = self.pipe.recv()
                if message is None:
                    self.done = True
                    self.process.join()
                    return
                self._take(message, result)
        except EOFError:
            self._replace("died", f"exit code {self._ended()}", result)
            return
        if time.monotonic() - self.place[2] > PATIENCE:
            self.process.kill()
            self._replace("hangs", f"beyond {PATIENCE:g} s outside Python", result)

    def _ended(self) -> int | None:
        self.process.join(5.0)
        return self.process.exitcode

    def _take(self, message: Any, result: Result) -> None:
        block, index, count, accepted, seconds, findings, memory = message
        self.read = block + 1
        tally = result.tallies.setdefault(KINDS[index].name, Tally())
        tally.inputs += count
        tally.accepted += accepted
        tally.seconds += seconds
        result.memory = max(result.memory, memory)
        for number, what, where in findings:
            result.note(KINDS[index].name, number, what, where)

    def _replace(self, what: str, where: str, result: Result) -> None:
        index, number = self.place[0], self.place[1]
        if number < 0:
            raise RuntimeError(f"a worker {what} before its first input: {where}; its own error stands above")
        result.note(KINDS[index].name, number, what, where)
        rest = self.blocks[self.read :]
        if rest:
            kind, first, count = rest[0]
            behind = [(kind, number + 1, first + count - number - 1)] if first + count > number + 1 else []
            self.blocks = behind + rest[1:]
        self._start()


def plan(inputs: int, kinds: list[Kind]) -> list[tuple[int, int, int]]:
    """Blocks of all kinds by their shares, in turn."""
    total = sum(kind.share for kind in kinds)
    every: list[list[tuple[int, int, int]]] = []
    for kind in kinds:
        count, index = max(round(inputs * kind.share / total), 1), KINDS.index(kind)
        every.append([(index, first, min(_BLOCK, count - first)) for first in range(0, count, _BLOCK)])
    longest = max(map(len, every))
    placed = [(at * longest / len(blocks), block) for blocks in every for at, block in enumerate(blocks)]
    return [block for _, block in sorted(placed)]


def campaign(inputs: int, seed: int, kinds: list[Kind], workers: int = WORKERS) -> Result:
    """All inputs, by forked workers."""
    result = Result()
    blocks = plan(inputs, kinds)
    base = SHARED_MEMORY if os.access(SHARED_MEMORY, os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=base) as folder:
        running = []
        for number in range(workers):
            own = Path(folder) / str(number)
            own.mkdir()
            running.append(Worker(blocks[number::workers], seed, own))
        try:
            while any(not worker.done for worker in running):
                for worker in running:
                    if not worker.done:
                        worker.look(result)
                time.sleep(0.05)
        finally:
            for worker in running:
                worker.process.kill()
                worker.process.join()
    return result


def report(result: Result, seconds: float) -> Iterator[str]:
    """The table, and the findings."""
    yield f"{'kind':20} {'inputs':>9} {'accepted':>9} {'a second':>9}"
    for kind in KINDS:
        tally = result.tallies.get(kind.name)
        if tally is not None:
            rate = tally.inputs / max(tally.seconds, 1e-9)
            yield f"{kind.name:20} {tally.inputs:9} {tally.accepted:9} {rate:9.0f}"
    total = sum(tally.inputs for tally in result.tallies.values())
    yield f"{total} inputs in {seconds:.0f} s, at most {result.memory / 1e6:.0f} MB, {len(result.findings)} findings"
    for (kind, what, where), count in result.findings.most_common():
        yield f"  {kind} --only {result.first[kind, what, where]}: {what}, {count} times: {where}"


def main(arguments: list[str] | None = None) -> int:
    """0 without findings."""
    parser = argparse.ArgumentParser(prog="python -m bench.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", action="append", choices=[kind.name for kind in KINDS])
    parser.add_argument("--only", type=int, help="show one input of one kind, and what comes of it")
    given = parser.parse_args(arguments)
    kinds = [kind for kind in KINDS if not given.kind or kind.name in given.kind]
    if given.only is not None:
        return _show(kinds[0], given.seed, given.only)
    begun = time.monotonic()
    result = campaign(given.inputs, given.seed, kinds)
    for line in report(result, time.monotonic() - begun):
        print(line)
    return 1 if result.findings else 0


def _show(kind: Kind, seed: int, number: int) -> int:
    data = input_of(kind, seed, number, corpus(kind.name))
    sys.stdout.buffer.write(data[:2000] + b"\n")
    with tempfile.TemporaryDirectory() as folder:
        print(kind.name, number, "accepted" if kind.run(data, Path(folder)) else "refused")
    return 0


if __name__ == "__main__":
    sys.exit(main())
