"""Units that foreign files write: what they measure and their factor to SI."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

TURN = 2.0 * math.pi

_SCALED = {
    "time": {
        1.0: "s sec secs second seconds",
        1e-3: "ms msec millisecond milliseconds",
        1e-6: "us µs usec microsecond microseconds",
        1e-9: "ns nanosecond nanoseconds",
        60.0: "min minute minutes",
    },
    "angle": {
        1.0: "rad radian radians",
        1e-3: "mrad",
        1e-6: "urad µrad",
        math.pi / 180.0: "deg degree degrees °",
        TURN: "rev revs turn turns revolution revolutions umdr",
    },
    "length": {
        1.0: "m meter metre meters metres",
        1e-2: "cm",
        1e-3: "mm",
        1e-6: "um µm micron",
        1e-9: "nm",
    },
    "angular speed": {
        1.0: "rad/s rads radps rad/sec rads-1",
        1e-3: "mrad/s",
        math.pi / 180.0: "deg/s °/s degps deg/sec degree/s degrees/s",
        TURN: "rev/s rps turn/s turns/s",
        TURN / 60.0: "rpm 1/min min-1 u/min rev/min r/min umdr/min turns/min",
        TURN / 60e3: "mrpm",
    },
    "linear speed": {
        1.0: "m/s mps m/sec",
        1e-2: "cm/s",
        1e-3: "mm/s mmps mm/sec",
        1e-6: "um/s µm/s",
        1.0 / 60.0: "m/min",
        1e-3 / 60.0: "mm/min",
    },
    "torque": {
        1.0: "nm n·m n*m n.m n-m newtonmeter",
        1e-3: "mnm mn·m mn*m",
        1e-6: "unm µnm un·m µn·m",
        1e-2: "ncm n·cm",
        1e3: "knm",
    },
    "force": {1.0: "n newton newtons", 1e-3: "mn", 1e3: "kn"},
    "current": {1.0: "a amp amps ampere amperes arms a_rms apk", 1e-3: "ma"},
    "voltage": {1.0: "v volt volts", 1e-3: "mv"},
    "temperature": {1.0: "°c c degc celsius"},
    "share": {1e-2: "% percent", 1e-3: "‰ permil permille 0.1%"},
    "counts": {1.0: "count counts cnt cnts inc incs increments qc tick ticks pulse pulses lsb"},
    "count rate": {1.0: "counts/s inc/s qc/s cnt/s ticks/s pulses/s"},
}


@dataclass(frozen=True, slots=True)
class Unit:
    """A known unit: `kind` is what it measures, `factor` takes it to SI."""

    text: str
    kind: str
    factor: float


_UNITS = {
    word: Unit(word, kind, factor)
    for kind, factors in _SCALED.items()
    for factor, words in factors.items()
    for word in words.split()
}
_CASED = {"MN": None, "mN": _UNITS["mn"], "MNm": None, "mNm": _UNITS["mnm"], "MW": None}
_SUFFIXES = frozenset(
    word
    for kind in ("time", "angle", "length", "angular speed", "torque", "current", "counts")
    for words in _SCALED[kind].values()
    for word in words.split()
    if word not in ("min", "u", "a", "cm")
)
_NOT_LENGTH = frozenset({"nm"})
_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(<{]\s*(?P<unit>[^\])>}]*)\s*[\])>}]\s*$")
_WORDED = re.compile(r"^(?P<name>.*\S)\s*[,/]\s*(?P<unit>\S+)$")
_SUFFIXED = re.compile(r"^(?P<name>.*[^_\s])[_\s](?P<unit>[^_\s]+)$")


def find_unit(text: str, wanted: str = "") -> Unit | None:
    """The unit that a text names; None if it is none that is known.

    `nm` is a torque (Nm, badly written) unless a length is wanted.
    """
    bare = text.strip().strip("[](){}<>").strip().replace("μ", "µ").replace("^", "")
    if bare in _CASED:
        return _CASED[bare]
    compact = bare.replace(" ", "").lower().replace("⋅", "·").replace("−", "-")
    if compact in _NOT_LENGTH and (bare == "Nm" or wanted != "length"):
        return Unit("Nm", "torque", 1.0)
    return _UNITS.get(compact)


def split_unit(header: str) -> tuple[str, str]:
    """Name and unit text of a header such as `Position [deg]`, `pos_deg`, `Torque in Nm`."""
    bare = header.strip()
    found = _BRACKETS.match(bare)
    if found and found["name"].strip():
        return found["name"].strip(), found["unit"].strip()
    found = _SUFFIXED.match(bare)
    if found and found["unit"].lower() in _SUFFIXES and not (found["unit"] == "m" and "_m" in bare):
        return re.sub(r"(\s+in|\s*[,/])$", "", found["name"]), found["unit"]
    found = _WORDED.match(bare)
    if found and find_unit(found["unit"]):
        return found["name"], found["unit"]
    return bare, ""
