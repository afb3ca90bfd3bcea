"""A year in minutes: one axis, one service, 365 nights, an accelerated clock.

What happens to the axis (nobody tells the service):

| day | what |
|---|---|
| all | temperature follows the season, 25 ± 8 °C, ± 1.5 K from day to day; friction −0.7 % a kelvin |
| 60–130 | wear: friction creeps up by 40 % |
| 131 | re-greased: friction falls by 35 % at once |
| 200 | one day on which the axis sticks: friction 80 % up |
| 245–247 | a bad encoder: 3000 counts instead of 50000 |
| 290–330 | slower wear, 20 % |
| 40, 41, 180, 181, 182 | power cuts over night: the service is not there |

The jobs are done by a process of their own, as in the real service, so that the memory is the service's.

    python -m bench.year [--days 365] [--seed 1] [--out FILE.json]
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import resource
import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from autotune.core.axis import read_axis
from autotune.core.drive import Command, Mode, Sample, Standing
from autotune.core.loop import LocalLoop
from autotune.core.paths import config_directory
from autotune.service.database import open_database
from autotune.service.housekeeping import MEGABYTE, prune, used
from autotune.service.inline import Ended, do_at_once
from autotune.service.manager import Manager, plans_of
from autotune.service.orders import Order
from autotune.service.report_history import history_of
from autotune.service.schedule import Schedule
from autotune.service.settings import Configuration, read_service
from autotune.service.store import Store, moment
from autotune.service.taking_up import absorb
from autotune.service.work import Tools
from autotune.tuning.progress import Silent
from autotune_sim.effects import scale_friction
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset

START = datetime(2025, 1, 1, 12, tzinfo=UTC)
GREASED, STUCK, SLOW_WEAR = 131, 200, 290
BAD_ENCODER = range(245, 248)
CUTS = (40, 41, 180, 181, 182)
BUDGET = 300


@dataclass(frozen=True, slots=True)
class Day:
    """The truth of one day: friction relative to new at 25 °C, temperature, encoder."""

    friction: float
    temperature: float
    counts: int

    @property
    def at_temperature(self) -> float:
        return self.friction * (1.0 - 0.007 * (self.temperature - 25.0))


def day_of(number: int, random: np.random.Generator) -> Day:
    """What the axis is like on a day."""
    friction = 1.0 + 0.4 * np.clip((number - 60) / 70, 0.0, 1.0)
    if number >= GREASED:
        friction *= 0.65
    friction *= 1.0 + 0.2 * np.clip((number - SLOW_WEAR) / 40, 0.0, 1.0)
    friction *= 1.8 if number == STUCK else 1.0
    friction *= 1.0 + random.normal(0.0, 0.005)
    temperature = 25.0 - 8.0 * math.cos(2 * math.pi * (number - 20) / 365) + random.normal(0.0, 1.5)
    return Day(float(friction), float(temperature), 3000 if number in BAD_ENCODER else 50_000)


class YearDrive:
    """A simulated drive whose plant is that of the day; what it stores outlasts every power cut."""

    def __init__(self, day: Day, seed: int, stored: dict[str, float]) -> None:
        nominal = preset("edm-vertical")
        plant = scale_friction(nominal.plant, day.at_temperature)
        plant = replace(plant, viscous=plant.viscous * day.at_temperature, counts=day.counts)
        self._drive = SimDrive(replace(nominal, plant=plant), seed)
        self._stored, self._warmer = stored, day.temperature - 25.0
        if stored:
            self._drive.write_parameters(stored)

    @property
    def period(self) -> float:
        return self._drive.period

    @property
    def identity(self) -> Mapping[str, int | str]:
        return {**self._drive.identity, "serial": 1}

    def look(self) -> Standing:
        return self._drive.look()

    def enable(self, mode: Mode) -> None:
        self._drive.enable(mode)

    def step(self, command: Command) -> Sample:
        sample = self._drive.step(command)
        return sample._replace(temperature=sample.temperature + self._warmer)

    def disable(self) -> None:
        self._drive.disable()

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        return self._drive.read_parameters(names)

    def write_parameters(self, values: Mapping[str, float]) -> None:
        self._drive.write_parameters(values)

    def store(self) -> None:
        self._drive.store()
        self._stored.clear()
        self._stored.update(self._drive.read_parameters())

    def faults(self) -> list[str]:
        return self._drive.faults()

    def close(self) -> None:
        self._drive.close()


@dataclass
class World:
    """The clock, the axis of today, and what its drive remembers. Launches the jobs of the day."""

    seed: int
    workers: ProcessPoolExecutor
    now: datetime = START
    day: Day = Day(1.0, 25.0, 50_000)
    jobs: int = 0

    def __post_init__(self) -> None:
        self.stored: dict[str, float] = {}

    @property
    def number(self) -> int:
        return (self.now - START).days

    def start(self, order: Order) -> Ended:
        """Does a job on today's axis in the worker process, to its end."""
        self.jobs += 1
        seed = 1000 * self.seed + self.jobs
        ended, self.stored = self.workers.submit(_do, order, self.day, seed, self.stored, self.now).result()
        return ended


def _do(
    order: Order, day: Day, seed: int, stored: dict[str, float], now: datetime
) -> tuple[Ended, dict[str, float]]:
    """A job, in the worker process; returns what the drive remembers afterwards as well."""
    axis = read_axis(order.file)
    tools = Tools(axis, lambda: LocalLoop(YearDrive(day, seed, stored)), Silent(), lambda: now)
    return do_at_once(order, tools), stored


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--days", type=int, default=365)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="autotune-year-"))
    spawn = multiprocessing.get_context("spawn")
    try:
        with ProcessPoolExecutor(1, mp_context=spawn) as workers:
            found = live(folder, options.days, World(options.seed, workers))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print(json.dumps(found, indent=2))
    if options.out:
        options.out.write_text(json.dumps(found, indent=2))


def live(folder: Path, days: int, world: World) -> dict[str, Any]:
    """Lives through the days; returns the figures that the year is judged by."""
    configuration = _configuration(folder)
    random = np.random.default_rng(world.seed)
    notices: list[dict[str, Any]] = []
    memory: list[float] = []
    truth: list[Day] = []
    biggest = 0
    service: _Service | None = None
    began = time.monotonic()
    for number in range(days):
        world.day = day_of(number, random)
        truth.append(world.day)
        if number in CUTS and service is not None:
            service.close()
            service = None
        if number not in CUTS and service is None:
            service = _Service(configuration, world, notices)
        if number == 0 and service is not None:
            service.manager.submit("edm-vertical", "run", "http")
        world.now = START + timedelta(days=number)
        for _ in range(8):
            world.now += timedelta(hours=3)
            if service is not None:
                service.round()
        prune(configuration.runs, ["edm-vertical"], BUDGET * MEGABYTE)
        biggest = max(biggest, used(configuration.runs))
        memory.append(_memory())
    if service is None:
        service = _Service(configuration, world, notices)
    found = _judged(service.store, truth, notices)
    service.close()
    half = memory[len(memory) // 2 :]
    return {
        **found,
        "memory_MB": [round(memory[index]) for index in range(0, len(memory), 30)],
        "memory_growth_last_half_MB": round(half[-1] - half[0], 1),
        "largest_disk_MB": round(biggest / MEGABYTE),
        "disk_budget_MB": BUDGET,
        "wall_seconds": round(time.monotonic() - began, 1),
    }


class _Service:
    """The service without HTTP, on the world's clock."""

    def __init__(self, configuration: Configuration, world: World, notices: list[dict[str, Any]]) -> None:
        opened = open_database(configuration.history_url, configuration.state / "backups", world.now)
        self.store = Store(opened.engine)
        self._schedule = Schedule(opened.engine, plans_of(configuration), world.now)

        def tell(notice: Mapping[str, Any]) -> None:
            notices.append({**notice, "day": world.number})

        self.manager = Manager(
            configuration, self.store, self._schedule, world, tell,
            lambda: world.now, lambda: world.now.timestamp(),
        )  # fmt: skip
        absorb(self.store, configuration.runs)

    def round(self) -> None:
        for _ in range(4):
            self.manager.tick()

    def close(self) -> None:
        self._schedule.close()
        self.store.close()


def _configuration(folder: Path) -> Configuration:
    axis = (config_directory() / "axes" / "edm-vertical.toml").read_text()
    (folder / "axis.toml").write_text(
        axis.replace(
            "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5", "sim://edm-vertical?memory=none"
        )
    )
    (folder / "service.toml").write_text(
        f'schema = 1\nruns = "{folder / "runs"}"\n[[axes]]\nfile = "axis.toml"\n'
        'check = "30 3 * * *"\ntime_zone = "Europe/Zurich"\ncommit = "automatic"\n'
    )
    return read_service(folder / "service.toml")


def _judged(store: Store, truth: list[Day], notices: list[dict[str, Any]]) -> dict[str, Any]:
    checks = store.list_checks("edm-vertical", 1000)
    runs = store.list_runs("edm-vertical", 1000)
    tunings = [{"day": _day(run["at"]), "outcome": run["outcome"]} for run in runs]
    worse = [_day(c["at"]) for c in checks if c["peak_error"] > 1.05 * c["uncompensated"]]
    return {
        "checks": len(checks),
        "check_days": len({_day(c["at"]) for c in checks}),
        "tunings": tunings,
        "needless": sum(not _real(truth, tunings, i) for i in range(1, len(tunings))),
        "days_worse_than_uncompensated": worse,
        "worst_ratio_to_uncompensated": round(max(c["peak_error"] / c["uncompensated"] for c in checks), 2),
        "median_ratio_to_uncompensated": round(
            float(np.median([c["peak_error"] / c["uncompensated"] for c in checks])), 2
        ),
        "wear": _noticed(notices, 60, 130, "up"),
        "wear_true_10_percent_day": next(n for n, d in enumerate(truth) if n >= 60 and d.friction > 1.1)
        if len(truth) > 90
        else None,
        "greased": _noticed(notices, GREASED, GREASED + 10, "re-greasing"),
        "stuck": _noticed(notices, STUCK, STUCK + 4, ""),
        "encoder": _noticed(notices, BAD_ENCODER.start, BAD_ENCODER.stop + 2, "position signal"),
        "slow_wear": _noticed(notices, SLOW_WEAR, 360, "up"),
        "jobs": store.outcomes(),
        "history_sentences": history_of(store, "edm-vertical")["sentences"],
        "notices": [f"{n['day']}: {n['kind']}: {n['sentence']}" for n in notices],
    }


def _day(at: str) -> int:
    return (moment(at) - START).days


def _real(truth: list[Day], tunings: list[dict[str, Any]], index: int) -> bool:
    """Friction had moved by more than a tenth since the tuning before."""
    now = truth[min(tunings[index]["day"], len(truth) - 1)].at_temperature
    kept = [t for t in tunings[:index] if t["outcome"] == "kept"]
    before = truth[kept[-1]["day"]].at_temperature if kept else 1.0
    return abs(now / before - 1.0) > 0.10


def _noticed(notices: list[dict[str, Any]], first: int, last: int, word: str) -> dict[str, Any] | None:
    """The first notice in those days that says the word."""
    for notice in notices:
        if first <= notice["day"] <= last and word in notice["sentence"]:
            return {"day": notice["day"], "sentence": notice["sentence"]}
    return None


def _memory() -> float:
    """Resident memory [MB]."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / MEGABYTE


if __name__ == "__main__":
    main()
