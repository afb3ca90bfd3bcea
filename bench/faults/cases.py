"""What happens in a case of the campaign: drawn from its seed alone, told in one line.

The mix is by cost: most cases run in this process on a drive without a wire (0.3 to 2 s), a share behind
an slcan or moteus line with processes of their own (5 to 15 s), few are whole tuning runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

Random = np.random.Generator

DURATIONS: Mapping[str, float] = MappingProxyType(
    {
        "record presliding": 38.0,
        "record dahl": 25.0,
        "record benchmark": 12.0,
        "record high-speed": 10.6,
        "record steady-state": 45.0,
        "check": 29.0,
        "run --only experiment": 124.0,
        "run --only prove": 60.0,
        "run --only commit": 12.0,
        "run": 200.0,
    }
)
"""Programmes and their machine time on a sound axis with 5 repeats of 2 periods [s]."""
PREPARED = frozenset({"run --only prove", "run --only commit"})
"""Programmes that need what an earlier run has found."""
NAMED: Mapping[int, str] = MappingProxyType(
    {
        1224536: "encoder dead in presliding, then somebody leans on the axis",
        1225387: "encoder of a tenth in the first second of a session",
        1225326: "encoder and torque both turned round: a sound axis seen in a mirror",
        1225480: "a silence of one cycle, recorded as missed",
        8309074: "encoder reversed in torque mode, then a leap: the drive's own reaction to its fault",
        8308026: "a wire that garbles a fifth of all frames for a second",
        8309344: "frames late for half a minute",
        10001301: "a wire that garbles frames while everything is put back",
    }
)
"""Cases of reported batches that were open for long: `--named` plays them."""
CUT_SHORT = 10_000_000
"""Seeds from here on have cases that were not drawn before; those reported before stay what they were."""
_HERE = ("record presliding", "record dahl", "record benchmark", "record high-speed", "record steady-state",
         "check", "run --only experiment", "run --only prove", "run --only commit", "run")  # fmt: skip
_HERE_WEIGHTS = (0.2, 0.1, 0.07, 0.1, 0.08, 0.13, 0.14, 0.05, 0.08, 0.05)
_WIRE = ("record presliding", "record dahl", "record benchmark", "record high-speed", "check",
         "run --only commit")  # fmt: skip
_WIRE_WEIGHTS = (0.3, 0.2, 0.2, 0.15, 0.1, 0.05)
KINDS: Mapping[str, float] = MappingProxyType(
    {"plant": 0.46, "drive": 0.2, "disk": 0.06, "clock": 0.03, "signal": 0.07, "wire": 0.13, "line": 0.05}
)
"""Share of each kind: hurts inside the axis, failures of the drive, the disk, the clocks, signals to the program;
`wire`: behind an slcan adapter, `line`: behind a moteus line, with any of these and with proxy and kills."""


@dataclass(frozen=True, slots=True)
class Case:
    """One run and what goes wrong in it.

    Attributes:
        programme: of `DURATIONS`.
        orders: faults of the drive as `autotune_sim` takes them.
        host: what happens to the program: (what, which, when), or nothing.
        proxy: what happens on the wire: operations as `proxy` takes them.
        plant: seed of the axis; `limits`: of the axis file.
        counts: encoder counts a revolution of the drive, where they are not those of the axis file.
    """

    seed: int
    kind: str
    programme: str
    plant: int
    limits: tuple[tuple[str, float], ...]
    orders: tuple[str, ...] = ()
    host: tuple[str, str, float] | None = None
    proxy: tuple[str, ...] = ()
    counts: int | None = None

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the drive's faults."""
        return tuple(order.partition("@")[0].partition("=")[0] for order in self.orders)

    def text(self) -> str:
        """What is done and when, in one line."""
        parts = [self.programme, *self.orders]
        if self.counts is not None:
            parts.append(f"encoder-counts={self.counts}@0")
        if self.host is not None:
            what, which, when = self.host
            parts.append(f"{what}:{which}@{when:g}")
        return " ".join([*parts, *self.proxy])


def draw(seed: int, kind: str | None = None) -> Case:
    """The case of a seed; `kind` fixes what is otherwise drawn."""
    random = np.random.default_rng([seed, 70])
    drawn = str(random.choice(list(KINDS), p=list(KINDS.values())))
    chosen = kind or drawn
    far = chosen in ("wire", "line")
    names, weights = (_WIRE, _WIRE_WEIGHTS) if far else (_HERE, _HERE_WEIGHTS)
    programme = str(random.choice(names, p=weights))
    if chosen == "line" and programme in PREPARED:
        programme = "record benchmark"
    parts = _DRAW[chosen](random, _when(random, programme, far))
    case = Case(
        seed,
        chosen,
        programme,
        plant=int(random.integers(1, 1000)),
        limits=_limits(random),
        **parts,
    )
    return _cut_short(case) if seed >= CUT_SHORT else case


def _cut_short(case: Case) -> Case:
    """In a third of the cases with a bad wire the run is interrupted while it is bad: all is put back over it."""
    random = np.random.default_rng([case.seed, 71])
    if not case.proxy or random.random() > 0.33:
        return case
    begin = float(case.proxy[0].rpartition("@")[2])
    when = max(begin + float(random.uniform(-0.02, 0.3)), 0.05)
    return replace(case, host=("process", "int-owner", round(when, 3)))


def _when(random: Random, programme: str, far: bool) -> float:
    """Enabled time of the fault [s]; behind a wire early, for every second there costs one of ours."""
    latest = min(DURATIONS[programme], 8.0 if far else 1e9)
    return round(float(random.uniform(0.02, 0.95)) * latest, 3)


def _limits(random: Random) -> tuple[tuple[str, float], ...]:
    """Limits of the axis, not those that everything was tried with."""
    reach = float(random.uniform(6.0, 20.0))
    return (
        ("position_min", -round(reach, 2)),
        ("position_max", round(reach, 2)),
        ("speed", round(float(random.uniform(12.0, 20.0)), 2)),
        ("deceleration", round(float(random.uniform(150.0, 400.0)), 1)),
        ("temperature", round(float(random.uniform(45.0, 80.0)), 1)),  # the drive's own limit is 80 °C
    )


def _signed(random: Random, low: float, high: float) -> float:
    return float(random.uniform(low, high) * random.choice([-1.0, 1.0]))


def _value(name: str, random: Random) -> str:
    low_high = _RANGES.get(name)
    if low_high is None:
        return ""
    low, high, signed = low_high
    number = _signed(random, low, high) if signed else float(random.uniform(low, high))
    return f"={number:.4g}".replace("e-0", "e-")


_RANGES: Mapping[str, tuple[float, float, bool]] = MappingProxyType(
    {
        "encoder-jump": (0.05, 3.0, True),
        "torque-constant": (0.3, 1.8, False),
        "stage-stuck": (0.2, 1.2, True),
        "runaway": (0.4, 1.0, True),
        "load-step": (0.1, 0.6, True),
        "load-wave": (0.1, 0.5, False),
        "leaning": (0.1, 0.5, True),
        "inertia-step": (0.4, 3.0, False),
        "end-stop": (0.01, 0.3, False),
        "collision": (0.01, 0.3, False),
        "temperature-slow": (20.0, 300.0, False),
        "temperature-rise": (40.0, 90.0, False),
        "second-master": (0.02, 0.12, True),
    }
)
_PLANT = ("encoder-frozen", "encoder-frozen", "encoder-jump", "encoder-reversed", "encoder-scale",
          "encoder-scale", "velocity-unit", "torque-constant", "torque-reversed", "stage-stuck", "runaway",
          "load-step", "load-step", "load-wave", "leaning", "inertia-step", "end-stop", "collision",
          "temperature-slow", "temperature-frozen", "temperature-rise")  # fmt: skip
_DRIVE = ("silent", "power-loss", "drive-fault", "following-error", "blocked", "enable-missing", "brake-missing",
          "hot", "missed-cycles", "write-refused", "store-refused", "nvm", "stop-fault", "stop-fault",
          "rpdo-lost", "rpdo-lost", "second-master", "second-master")  # fmt: skip
_WIRE_DRIVE = ("silent", "unplugged", "power-loss", "drive-fault", "enable-missing", "brake-missing", "blocked",
               "hot", "frames-lost", "stop-fault", "rpdo-lost", "second-master", "status-word",
               "emcy")  # fmt: skip


def plant_order(random: Random, when: float) -> str:
    """One thing that breaks inside the axis."""
    name = str(random.choice(_PLANT))
    if name == "encoder-scale":
        return f"{name}={random.choice([0.1, 10.0, 0.5, 2.0]):g}@{when}"
    if name == "velocity-unit":
        return f"{name}={random.choice([0.1, 10.0]):g}@{when}"
    return f"{name}{_value(name, random)}@{when}"


def _plant(random: Random, when: float) -> dict[str, tuple[str, ...]]:
    """One fault, in a third of the cases two."""
    orders = [plant_order(random, when)]
    if random.random() < 0.33:
        orders.append(plant_order(random, round(when + float(random.uniform(0.0, 3.0)), 3)))
    return {"orders": tuple(orders)}


def _drive(random: Random, when: float) -> dict[str, tuple[str, ...]]:
    name = str(random.choice(_DRIVE))
    if random.random() < 0.15:  # what cannot be written or stored may be so from the beginning
        when = 0.0
    orders = [f"{name}{_value(name, random)}@{when}"]
    if random.random() < 0.2:
        orders.append(plant_order(random, round(when + float(random.uniform(0.0, 2.0)), 3)))
    return {"orders": tuple(orders)}


def _disk(random: Random, when: float) -> dict[str, tuple[str, str, float]]:
    which = str(random.choice(["full", "read-only", "small-files", "torn"]))
    most = 50 if when > 20.0 else 12  # short programmes write little
    return {"host": ("disk", which, float(random.integers(1, most)))}


def _clock(random: Random, when: float) -> dict[str, tuple[str, str, float]]:
    return {"host": ("clock", str(random.choice(["back-a-day", "forward-a-year", "to-1970"])), when)}


def _signal(random: Random, when: float) -> dict[str, Any]:
    host = ("signal", str(random.choice(["INT", "TERM", "HUP", "INT-twice"])), when)
    orders = (plant_order(random, when),) if random.random() < 0.15 else ()
    return {"host": host, "orders": orders}


def _wire(random: Random, when: float) -> dict[str, Any]:
    """A fault of the plant or the node, the wire itself, or the processes."""
    what = random.random()
    if what < 0.25:
        return {"orders": (plant_order(random, when),)}
    if what < 0.48:
        return {"orders": (_wire_order(random, when),)}
    if what < 0.51:
        return {"counts": int(random.choice([5_000, 25_000, 500_000]))}
    if what < 0.54:  # the temperature is not told any more, and then rises
        later, rise = round(when + float(random.uniform(0.1, 3.0)), 3), float(random.uniform(40.0, 54.0))
        return {"orders": (f"sdo-abort=2220:01@{when}", f"temperature-rise={rise:.3g}@{later}")}
    if what < 0.76:
        return {"proxy": (_proxy(random, when),)}
    return {"host": ("process", str(random.choice(PROCESS)), when)}


def _line(random: Random, when: float) -> dict[str, Any]:
    what = random.random()
    if what < 0.4:
        return {"orders": (plant_order(random, when),)}
    if what < 0.6:
        order = _wire_order(random, when)
        return {"orders": (order if not order.startswith(("status-word", "emcy")) else f"silent@{when}",)}
    if what < 0.8:
        return {"proxy": (_proxy(random, when),)}
    return {"host": ("process", str(random.choice(PROCESS)), when)}


PROCESS = ("stop-child", "stop-owner", "kill-child", "kill-owner", "kill-both", "starve-child", "starve-owner",
           "suspend", "stop-drive", "term-owner", "int-owner")  # fmt: skip
"""What may happen to the processes of a run behind a wire: SIGSTOP for good, SIGKILL, SIGSTOP and SIGCONT in
turns, all of the run stopped for 3 s, the drive's process stopped, and polite signals."""


def _wire_order(random: Random, when: float) -> str:
    name = str(random.choice(_WIRE_DRIVE))
    if name == "silent":
        return f"{name}={random.choice(['0.05', '0.5', '5', '60'])}@{when}"
    if name == "unplugged":
        return f"{name}={random.choice(['0.5', '60'])}@{when}"
    if name == "frames-lost":
        return f"{name}={random.choice(['0.5', '3', '20'])}@{when}"
    if name == "status-word":
        return f"{name}={random.choice(['0000', '0008', '0237', '02FF', '1240'])}@{when}"
    if name == "rpdo-lost":
        return f"{name}={random.choice(['10', '100', '100'])}@{when}"
    return f"{name}{_value(name, random)}@{when}"


def _proxy(random: Random, when: float) -> str:
    operation = str(random.choice(["lose", "delay", "double", "reorder", "corrupt", "garble", "foreign"]))
    share = float(random.choice([0.002, 0.02, 0.2]))
    length = float(random.choice([0.2, 1.0, 30.0]))
    return f"{operation}={share:g}:{length:g}@{when}"


_DRAW: Mapping[str, Callable[[Random, float], Mapping[str, Any]]] = MappingProxyType(
    {
        "plant": _plant,
        "drive": _drive,
        "disk": _disk,
        "clock": _clock,
        "signal": _signal,
        "wire": _wire,
        "line": _line,
    }
)
