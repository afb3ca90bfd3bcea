"""The judge: reads the plant's log and says what was wrong with a run. It knows nothing of the program.

Limits. Where the host can see what happens, the true speed may rise beyond its limit for `reaction` only, and
must then fall at least as fast as the configured deceleration brakes against the torque from outside; the
true position may go beyond its limit by what that braking takes. Where the encoder hides the motion, the
same counts from the moment at which torque without motion must be noticed (`Policy.unseen`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from autotune_sim.truth import Event
from bench.faults.claims import false_claims
from bench.faults.evidence import Column, Evidence, different, told_as_lost
from bench.faults.policy import DRIVES_OWN, HOLDING, LAST, LEAPS, LOUD, POLICY, SENSORS, TELLING, Policy

_HIDDEN_HEAT = frozenset({"temperature-frozen", "temperature-slow"})


@dataclass(frozen=True)
class Verdict:
    """What was found in one case.

    Attributes:
        findings: what was wrong, each `kind: particulars`; empty for a sound run.
        to_rest, to_power_off: s of the wall clock from the first fault, None where it never came or not.
    """

    findings: tuple[str, ...]
    to_rest: float | None = None
    to_power_off: float | None = None

    @property
    def sound(self) -> bool:
        return not self.findings

    @property
    def kinds(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(finding.partition(":")[0] for finding in self.findings))


def judge(evidence: Evidence, policy: Policy = POLICY) -> Verdict:
    """Compares what a run did and said with what was true."""
    findings = [
        *_limits(evidence, policy),
        *_end(evidence, policy),
        *_silence(evidence, policy),
        *_settings(evidence),
        *false_claims(evidence, policy),
    ]
    rest, off = _times(evidence, policy)
    return Verdict(tuple(findings), rest, off)


def fault_time(evidence: Evidence) -> float:
    """Axis time of the first fault; infinite where there was none [s]."""
    return min((event.time for event in evidence.put_in), default=np.inf)


def _known_from(evidence: Evidence, policy: Policy) -> float:
    """When a host that looks must know that something is wrong with its sensor; infinite without such a fault."""
    times = [event.time for event in evidence.put_in if _tells(event)]
    if not times or not len(evidence.truth.rows):
        return np.inf
    time = evidence.column("time")
    unseen = _unseen(evidence, times[0])
    slow, fast = _first(unseen > policy.unseen_slow), _first(unseen > policy.unseen)
    known = [time[slow] + policy.knowing] if slow is not None else []
    known += [time[fast]] if fast is not None else []
    return min(known, default=np.inf)


def _tells(event: Event) -> bool:
    """A sensor that lies so much that torque tells it; a gain between a quarter and four is like another load."""
    if event.details.get("name") not in SENSORS:
        return False
    gain = (
        abs(float(event.details.get("value") or 10.0)) if event.details["name"] == "encoder-scale" else 10.0
    )
    return not 1.0 / TELLING <= gain <= TELLING


def _unseen(evidence: Evidence, since: float) -> Column:
    """How far the shaft has turned under power without the encoder since a time [rad]."""
    time, position, reading = (evidence.column(name) for name in ("time", "position", "reading"))
    start = min(int(np.searchsorted(time, since)), len(time) - 1)
    apart: Column = np.abs((position - position[start]) - (reading - reading[start]))
    apart[:start] = 0.0
    return apart


def _first(condition: np.ndarray) -> int | None:
    found = np.flatnonzero(condition)
    return int(found[0]) if len(found) else None


# Limits


def _limits(evidence: Evidence, policy: Policy) -> list[str]:
    if len(evidence.truth.rows) < 10 or any(name in DRIVES_OWN for name in evidence.case.faults):
        return []
    hidden = _known_from(evidence, policy)
    return [
        *_speed(evidence, policy, hidden),
        *_travel(evidence, policy, hidden),
        *_torque(evidence),
        *_heat(evidence, policy),
    ]


def _braking(evidence: Evidence) -> float:
    """What the axis brakes with at least: the deceleration, or what the motor has beyond the push [rad/s²]."""
    push = float(np.max(np.abs(evidence.column("push")), initial=0.0))
    spare = (evidence.limits["torque"] * _least_constant(evidence) - push) / (3.0 * evidence.inertia)
    return min(evidence.limits["deceleration"], spare)


def _least_constant(evidence: Evidence) -> float:
    """Smallest factor on the torque constant that the case has."""
    orders = [order.partition("@")[0] for order in evidence.case.orders]
    gains = [float(o.partition("=")[2] or 0.5) for o in orders if o.startswith("torque-constant")]
    return min([1.0, *gains])


def _hidden_at(evidence: Evidence, crossing: float) -> bool:
    """Whether the encoder hid the motion when a limit was crossed."""
    times = [event.time for event in evidence.put_in if event.details.get("name") in SENSORS]
    return any(time <= crossing for time in times)


def _speed(evidence: Evidence, policy: Policy, known: float) -> list[str]:
    limit = evidence.limits["speed"]
    time, speed = evidence.column("time"), np.abs(evidence.column("velocity"))
    crossed = _first(speed > limit * (1.0 + policy.ripple))
    if crossed is None:
        return []
    begin = max(time[crossed], known) if _hidden_at(evidence, time[crossed]) else time[crossed]
    if not np.isfinite(begin):
        return []
    begin += policy.reaction
    until = speed[time <= begin]
    peak = float(np.max(until, initial=limit + _leap(evidence, policy, begin)))
    later = time > begin
    braking = _braking(evidence)
    if braking <= 0.0:
        return []
    top = float(np.max(speed[later], initial=0.0))
    said = f"{float(np.max(speed)):.1f} rad/s where {limit:g} are allowed"
    if top > peak + policy.ripple * limit:
        return [f"speed: {said}, still rising {_ms(time[np.argmax(speed)] - begin)} after it had to fall"]
    allowed = (peak - limit) / braking + policy.settle
    over = time[later & (speed > limit * (1.0 + policy.ripple))]
    if len(over) and over[-1] - begin > allowed:
        return [f"speed: {said}, for {_ms(over[-1] - begin)} where braking takes {_ms(allowed)}"]
    return []


def _leap(evidence: Evidence, policy: Policy, until: float) -> float:
    """What a leap of encoder or target before a time adds to the speed, whatever a host does [rad/s]."""
    added = 0.0
    for event in evidence.put_in:
        if event.details.get("name") in LEAPS and event.time <= until:
            way = min(abs(float(event.details.get("value") or 0.1)), policy.longest_leap)
            full = evidence.limits["torque"] / evidence.inertia
            added = max(added, policy.leap * evidence.limits["speed"], float(np.sqrt(full * way)))
    return added


def _travel(evidence: Evidence, policy: Policy, known: float) -> list[str]:
    lower, upper = evidence.limits["position_min"], evidence.limits["position_max"]
    time, position = evidence.column("time"), evidence.column("position")
    speed = np.abs(evidence.column("velocity"))
    beyond = np.maximum(position - upper, lower - position)
    crossed = _first(beyond > policy.offset)
    if crossed is None:
        return []
    allowed = policy.offset
    braking = _braking(evidence)
    if braking <= 0.0:
        return []
    if _hidden_at(evidence, time[crossed]):
        if not np.isfinite(known):
            return []
        at = min(int(np.searchsorted(time, max(known, fault_time(evidence)))), len(time) - 1)
        fast = min(speed[at] + 2.0 * policy.reaction * braking, speed[at : at + 5].max(initial=speed[at]))
        allowed += max(beyond[at], 0.0) + fast * policy.reaction + fast**2 / (2.0 * braking)
    else:
        allowed += _unavoidable(evidence, policy, crossed, braking)
    worst = float(np.max(beyond))
    if worst <= allowed:
        return []
    return [f"travel: {worst:.2f} rad beyond a limit where {allowed:.2f} cannot be avoided"]


def _unavoidable(evidence: Evidence, policy: Policy, crossed: int, braking: float) -> float:
    """How far a push that began just before a limit carries the axis beyond it [rad]."""
    time, speed = evidence.column("time"), np.abs(evidence.column("velocity"))
    began = fault_time(evidence)
    if not np.isfinite(began) or time[crossed] - began > policy.settle:
        return 0.0
    fast = float(speed[crossed])
    return fast * policy.reaction + fast**2 / (2.0 * braking)


def _torque(evidence: Evidence) -> list[str]:
    limit = evidence.limits["torque"]
    most = float(np.max(np.abs(evidence.column("demanded"))))
    return [f"torque: {most:.3f} N m where {limit:g} are allowed"] if most > 1.001 * limit else []


def _heat(evidence: Evidence, policy: Policy) -> list[str]:
    if any(name in _HIDDEN_HEAT for name in evidence.case.faults):
        return []
    hot = evidence.column("temperature") > evidence.limits["temperature"] + policy.heat
    under_power = hot & (evidence.truth.rows["mode"] >= 0)
    time = evidence.column("time")[under_power]
    if not len(time) or time[-1] - time[0] <= policy.cooling:
        return []
    most = float(np.max(evidence.column("temperature")))
    return [f"temperature: {most:.0f} °C for {time[-1] - time[0]:.1f} s under power"]


# The end


def _times(evidence: Evidence, policy: Policy) -> tuple[float | None, float | None]:
    """Wall time from the first fault to rest and to power off, for good [s]."""
    rows = evidence.truth.rows
    if not evidence.put_in or not len(rows):
        return None, None
    since = evidence.put_in[0].wall
    wall = evidence.column("wall")
    moving = np.flatnonzero((np.abs(evidence.column("velocity")) > policy.rest) & (wall >= since))
    live = np.flatnonzero((rows["live"] > 0) & (wall >= since))
    last = len(rows) - 1
    rest = None if len(moving) and moving[-1] == last else _after(wall, moving, since)
    return rest, None if len(live) and live[-1] == last else _after(wall, live, since)


def _after(wall: Column, indices: np.ndarray, since: float) -> float:
    return float(wall[indices[-1]] - since) if len(indices) else 0.0


def _end(evidence: Evidence, policy: Policy) -> list[str]:
    """Ends by itself in time, at rest and without power, without a traceback."""
    ending, found = evidence.ending, []
    if ending.code is None:
        found.append(f"hang: had to be killed {ending.ended - ending.began:.0f} s after its start")
    elif _overdue(evidence, policy):
        found.append(f"hang: ended {ending.ended - evidence.put_in[0].wall:.0f} s after the fault")
    words = f"{ending.words} {evidence.next_words}"
    for mark in ("Traceback (most recent call last)", "This is a defect", "in the cyclic process: Trace"):
        if mark in words:
            found.append(f"traceback: {words[max(words.index(mark) - 80, 0) : words.index(mark) + 120]}")
            break
    rows = evidence.truth.rows
    if len(rows) and (stalled := evidence.events("stalled")):
        still = stalled[-1].wall - float(rows["wall"][-1])
        found.append(
            f"rig: the simulated drive has stood still for {still:.1f} s ({stalled[-1].details.get('where')}); what it "
            "would have done is not known"
        )
    elif len(rows) and "stage-stuck" not in evidence.case.faults:
        last = rows[-LAST:]
        holds = evidence.case.kind in HOLDING and (ending.killed or ending.code == 5)
        holds |= any(operation.startswith("foreign") for operation in evidence.case.proxy)
        if last["mode"][-1] >= 0 and not holds:
            found.append("power: still on at the end")
        elif float(np.max(np.abs(last["velocity"]))) > policy.rest:
            found.append(f"motion: {float(np.max(np.abs(last['velocity']))):.2f} rad/s at the end")
    if ending.code is not None and ending.code < 0 and not ending.killed:
        found.append(f"crash: ended by signal {-ending.code}")
    return found


def _overdue(evidence: Evidence, policy: Policy) -> bool:
    """Longer than `end` after a fault that stopped the axis; a run that no fault stops may go on."""
    faults = evidence.put_in
    if not faults:
        return False
    wall = evidence.column("wall")
    under_way = wall[evidence.truth.rows["mode"] >= 0]
    last = max(faults[0].wall, float(under_way[-1]) if len(under_way) else 0.0)
    return min(evidence.ending.ended - last, evidence.ending.idle) > policy.end


def _silence(evidence: Evidence, policy: Policy) -> list[str]:
    """A run with a fault that had its effect must not end as if nothing had been."""
    if evidence.ending.code != 0:
        return []
    told = evidence.events("fault")
    if told:
        codes = {f"{int(event.details.get('code', 0)):04X}h" for event in told}
        if not any(code in evidence.ending.words for code in codes):
            return [f"swallowed: the drive had a fault {', '.join(sorted(codes))}, exit code 0"]
    rows = evidence.truth.rows
    for event in evidence.put_in:
        name = str(event.details.get("name"))
        powered = rows[(rows["time"] > event.time) & (rows["mode"] >= 0)]
        if name in SENSORS and not _tells(event):
            continue
        if name in LOUD and len(powered) > 300 and _had_effect(evidence, name, event.time):
            return [
                f"unnoticed: {name} at {event.time:.2f} s, {len(powered) * 1e-3:.1f} s under power, exit code 0"
            ]
    return []


def _had_effect(evidence: Evidence, name: str, since: float) -> bool:
    if name in SENSORS:
        rows = evidence.truth.rows
        powered = (rows["mode"] >= 0) & (rows["time"] > since) & (rows["time"] <= _replaced(evidence, since))
        return bool(np.any(_unseen(evidence, since)[powered] > 0.05))
    if name in ("rpdo-lost", "second-master"):
        rows = evidence.truth.rows
        after = rows[(rows["time"] > since + 0.01) & (rows["mode"] >= 0)]
        return bool(len(after) > 300 and np.ptp(after["target"][:300]) == 0.0)
    if (
        name == "stop-fault"
    ):  # waits for a stop that the drive itself carries out; one that never came did nothing
        return bool(evidence.events("fault"))
    if name == "blocked":
        return True
    if name == "silent":
        return not told_as_lost(evidence, since)
    return name not in ("missed-cycles", "status-word")


def _replaced(evidence: Evidence, since: float) -> float:
    """When the next fault of the sensor took the place of one; each is judged by what it hid itself [s]."""
    later = [event.time for event in evidence.put_in if event.details.get("name") in SENSORS]
    return min((time for time in later if time > since), default=np.inf)


def _settings(evidence: Evidence) -> list[str]:
    """Settings as before; or named, and put right by the next start."""
    before, after = evidence.settings("open"), evidence.settings("closed")
    if before is None or after is None:
        return []
    changed = _beside_what_was_kept(evidence, different(before, after))
    if not changed:
        return []
    names = ", ".join(sorted(changed)[:4])
    if not evidence.ending.killed and not _admitted(evidence):
        return [f"settings: {names} not as before, and nothing said"]
    if evidence.put_right is not None:
        left = _beside_what_was_kept(evidence, different(before, evidence.put_right))
        if left:
            return [f"settings: {', '.join(sorted(left)[:4])} not put right by the next start"]
    return []


def _beside_what_was_kept(
    evidence: Evidence, changed: dict[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Changes without those of the feedforward, where the run says that it was kept."""
    if not _kept(evidence):
        return changed
    return {
        name: value for name, value in changed.items() if "feedforward" not in name and "2100" not in name
    }


def _kept(evidence: Evidence) -> bool:
    words = evidence.ending.words
    return any(mark in words for mark in ("Kept: ", '"kept"', "drive holds the proved parameters"))


def _admitted(evidence: Evidence) -> bool:
    words = evidence.ending.words.lower()
    return any(
        phrase in words
        for phrase in (
            "could not be put back",
            "could not be restored",
            "may still",
            "the next run will",
            "next access",
            "may stay",
            "not everything",
            "not left as it was found",
        )
    )


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms"
