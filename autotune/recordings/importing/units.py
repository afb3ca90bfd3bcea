"""Units that foreign files write: what they measure and their factor to SI."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

TURN = 2.0 * math.pi

INCH, FOOT, POUND, OUNCE, KILOPOND = 0.0254, 0.3048, 4.4482216152605, 0.27801385095378, 9.80665

SCALED = {
    "time": {
        1.0: "s sec secs second seconds sek sekunde sekunden seconde secondes",
        1e-3: "ms msec msecs millisecond milliseconds millisekunde millisekunden milliseconde millisecondes",
        1e-6: "us µs usec µsec microsecond microseconds mikrosekunde mikrosekunden microseconde microsecondes",
        1e-9: "ns nsec nanosecond nanoseconds nanosekunde nanosekunden",
        60.0: "min minute minutes minuten",
    },
    "angle": {
        1.0: "rad radian radians radiant radiants",
        1e-3: "mrad",
        1e-6: "urad µrad",
        math.pi / 180.0: "deg degs degree degrees ° grad winkelgrad degré degrés altgrad",
        math.pi / 180e3: "mdeg m°",
        math.pi / 10800.0: "arcmin arcminute arcminutes winkelminuten",
        math.pi / 648e3: "arcsec arcsecond arcseconds winkelsekunden",
        TURN / 400.0: "gon gradian gradians neugrad",
        TURN: "rev revs turn turns revolution revolutions umdr umdr. umdrehung umdrehungen tr tour tours",
    },
    "length": {
        1.0: "m meter metre meters metres mètre mètres",
        1e-1: "dm",
        1e-2: "cm centimeter centimetre zentimeter centimètre centimètres",
        1e-3: "mm millimeter millimetre millimeters millimetres millimètre millimètres",
        1e-6: "um µm micron microns micrometer micrometre mikrometer micromètre micromètres",
        1e-9: "nm nanometer nanometre nanomètre",
        INCH: "in inch inches zoll pouce pouces",
        1e-3 * INCH: "mil mils thou",
        FOOT: "ft foot feet",
    },
    "angular speed": {
        1.0: "rad/s rads radps rad/sec rad/sek rads-1 rad·s-1 rad.s-1 rad*s-1",
        1e-3: "mrad/s",
        1.0 / 60.0: "rad/min",
        math.pi
        / 180.0: "deg/s °/s degps dps deg/sec °/sec degree/s degrees/s grad/s degré/s degrés/s deg·s-1 °s-1",
        math.pi / 10800.0: "deg/min °/min grad/min",
        TURN: "rev/s revs/s rps turn/s turns/s u/s umdr/s umdr./s umdrehungen/s tr/s tour/s tours/s",
        TURN
        / 60.0: "rpm 1/min min-1 u/min upm rev/min revs/min r/min umdr/min umdr./min umdrehungen/min turn/min "
        "turns/min tr/min tour/min tours/min",
        TURN / 60e-3: "krpm",
        TURN / 60e3: "mrpm",
    },
    "linear speed": {
        1.0: "m/s mps m/sec m/sek ms-1 m·s-1 m.s-1",
        1e-2: "cm/s",
        1e-3: "mm/s mmps mm/sec mm/sek mms-1 mm·s-1 mm.s-1",
        1e-6: "um/s µm/s",
        1.0 / 60.0: "m/min",
        1e-3 / 60.0: "mm/min",
        INCH: "in/s inch/s inches/s ips",
        INCH / 60.0: "in/min inch/min ipm",
        FOOT: "ft/s",
        FOOT / 60.0: "ft/min fpm",
    },
    "torque": {
        1.0: "nm n·m n*m n.m n-m newtonmeter newtonmetre newton-meter newton-metre newtonmètre newton-mètre",
        1e-3: "mnm mn·m mn*m mn.m mn-m nmm n·mm n*mm n.mm millinewtonmeter",
        1e-6: "unm µnm un·m µn·m µn.m",
        1e-2: "ncm n·cm n*cm n.cm cnm",
        1e1: "danm dan·m dan.m",
        1e3: "knm kn·m kn*m kn.m",
        INCH * POUND: "lbf·in lbfin lbf-in lbin lb-in lb·in in-lb inlb in·lb in-lbf in·lbf",
        FOOT * POUND: "lbf·ft lbfft lbf-ft lbft lb-ft lb·ft ft-lb ftlb ft·lb ft-lbf ft·lbf",
        INCH * OUNCE: "ozf·in ozfin ozf-in ozin oz-in oz·in in-oz in·oz",
        1e-2 * KILOPOND: "kgf·cm kgfcm kgf-cm kpcm",
        KILOPOND: "kgf·m kgfm kgf-m kpm",
    },
    "force": {
        1.0: "n newton newtons",
        1e-3: "mn millinewton",
        1e1: "dan",
        1e3: "kn kilonewton",
        POUND: "lbf",
        OUNCE: "ozf",
        KILOPOND: "kgf kp",
    },
    "current": {
        1.0: "a amp amps ampere amperes ampère ampères arms a_rms apk",
        1e-3: "ma marms milliampere milliamperes milliampère milliampères",
    },
    "voltage": {1.0: "v volt volts", 1e-3: "mv millivolt millivolts"},
    "temperature": {1.0: "°c c degc celsius grdc"},
    "share": {1e-2: "% percent prozent pourcent pct", 1e-3: "‰ permil permille promille 0.1%"},
    "counts": {
        1.0: "count counts cnt cnts inc incs increment increments inkr inkrement inkremente incrément incréments qc "
        "tick ticks pulse pulses puls impuls impulse impulsion impulsions lsb"
    },
    "count rate": {
        1.0: "counts/s cnts/s inc/s incs/s inkr/s inkremente/s qc/s cnt/s ticks/s pulses/s impulse/s"
    },
}
"""What a unit measures → its factor to SI → how it is written in English, German and French, without blanks."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A known unit: `kind` is what it measures, `factor` takes it to SI."""

    text: str
    kind: str
    factor: float


_UNITS = {
    word: Unit(word, kind, factor)
    for kind, factors in SCALED.items()
    for factor, words in factors.items()
    for word in words.split()
}
_CASED = {"MN": None, "mN": _UNITS["mn"], "MNm": None, "mNm": _UNITS["mnm"], "MW": None}
_SUFFIXES = frozenset(
    word
    for kind in ("time", "angle", "length", "angular speed", "torque", "current", "counts")
    for words in SCALED[kind].values()
    for word in words.split()
    if word
    not in ("min", "u", "a", "cm", "in", "tr", "tour", "tours", "turn", "mil", "thou", "foot", "feet", "dm")
)
_NANOMETRE = Unit("nm", "length", 1e-9)
_OF_FORCE = re.compile("force|kraft|thrust|schub")
_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(<{]\s*(?P<unit>[^\])>}]*)\s*[\])>}]\s*$")
_WORDED = re.compile(r"^(?P<name>.*\S)\s*[,/]\s*(?P<unit>\S+)$")
_SUFFIXED = re.compile(r"^(?P<name>.*[^_\s])[_\s](?P<unit>[^_\s]+)$")
_RATE = re.compile(
    r"^(?P<name>.*[^_\s])[_\s](?P<of>(?!per[_\s])[^_\s]+)[_\s](?:per[_\s])?(?P<time>s|sec|sek|min)$",
    re.IGNORECASE,
)
"""A speed's unit written in words, as no slash may stand in a name: `vel_deg_s`, `dq_rad_per_s`."""
_SPEEDS = ("angular speed", "linear speed", "count rate")


def find_unit(text: str, wanted: str = "") -> Unit | None:
    """The unit that a text names, called as it is written there; None if it is none that is known.

    `nm` is a torque (Nm, badly written) unless a length is wanted.
    """
    bare = text.strip().strip("[](){}<>").strip().replace("μ", "µ").replace("^", "").replace("⁻¹", "-1")
    compact = bare.replace(" ", "").lower().replace("⋅", "·").replace("−", "-")
    if compact == _NANOMETRE.text:
        return _NANOMETRE if wanted == "length" and bare != "Nm" else Unit("Nm", "torque", 1.0)
    known = _CASED.get(bare, _UNITS.get(compact))
    return None if known is None else replace(known, text=bare.replace(" ", ""))


def _is_suffix(unit: str, name: str) -> bool:
    """Whether what a name ends with is a unit: a last `N` is one of a force, and a number of anything else."""
    return unit.lower() in _SUFFIXES or (unit == "N" and _OF_FORCE.search(name.lower()) is not None)


def split_unit(header: str) -> tuple[str, str]:
    """Name and unit text of a header such as `Position [deg]`, `pos_deg`, `vel_deg_s`, `Torque in Nm`."""
    bare = header.strip()
    found = _BRACKETS.match(bare)
    if found and found["name"].strip():
        return found["name"].strip(), found["unit"].strip()
    found = _RATE.match(bare)
    rate = f"{found['of']}/{found['time'].lower()}" if found else ""
    unit = find_unit(rate)
    if found and unit is not None and unit.kind in _SPEEDS:
        return found["name"], rate
    found = _SUFFIXED.match(bare)
    if found and _is_suffix(found["unit"], found["name"]) and not (found["unit"] == "m" and "_m" in bare):
        return re.sub(r"(\s+in|\s*[,/])$", "", found["name"]), found["unit"]
    found = _WORDED.match(bare)
    if found and find_unit(found["unit"]):
        return found["name"], found["unit"]
    return bare, ""
