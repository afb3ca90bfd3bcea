"""What the judge allows, with the reason for each number: the physically unavoidable and nothing more."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Policy:
    """Bounds of the judge.

    Attributes:
        reaction: s from what is true until the drive obeys. What happens in cycle k is in the sample of k + 1, which
            is looked at before command k + 2: two cycles of 1 ms, one more for a pipelined link, and one for the
            drive's own loop to turn its torque round.
        unseen: rad that the shaft may turn without the encoder, before a host must know. Torque beyond friction
            that gives no motion is the only sign; at full torque 0.1 rad takes 10 ms.
        unseen_slow: rad after which `knowing` seconds are enough, where little torque is at work.
        knowing: s, see above: 25 cycles of a reading that does not follow the torque.
        settle: s that braking may take longer than at constant deceleration: the position loop's own lag.
        ripple: relative to the speed limit; noise and ripple of the true speed are not a breach.
        offset: rad of an encoder's leap that cannot be told from motion at the speed limit in two cycles.
        leap: relative to the speed limit, after a leap of the encoder or of another master's target: the drive's own
            ramp begins at a speed that never was, its limit, and the position loop overshoots it.
        longest_leap: rad of a target that a drive follows at full torque before any host can see it.
        rest: rad/s, below which an axis is at rest; `rest_travel`: rad that it may creep after it.
        heat: °C beyond the limit while power goes; `cooling`: s for it.
        end: s from the fault to the end of the program.
        power_off: s from the fault of a link or a process to power off: the drive's heartbeat consumer (0.1 s
            here) or watchdog, its braking, and the patience of a simulated drive for a held-up master.
    """

    reaction: float = 4e-3
    unseen: float = 0.1
    unseen_slow: float = 0.02
    knowing: float = 0.025
    settle: float = 0.05
    ripple: float = 0.03
    offset: float = 0.05
    leap: float = 0.6
    longest_leap: float = 0.12
    rest: float = 0.1
    rest_travel: float = 0.01
    heat: float = 3.0
    cooling: float = 1.0
    end: float = 30.0
    power_off: float = 3.0


POLICY = Policy()
LAST = 5
"""Rows at the end of a log that must be at rest."""
HOLDING = frozenset({"line"})
"""Kinds of drives that hold their axis at rest, with power, when their host has gone (moteus after its watchdog).
Another master on the wire may switch power on again after ours has gone; no host can keep that off either."""
DRIVES_OWN = frozenset({"runaway", "stage-stuck", "torque-reversed"})
"""Faults of the output stage: no command of a host brakes such an axis. Only power off and the emergency stop do,
and in process the drive decides by itself when power goes. The judge holds them to words, codes and the end."""
SENSORS = frozenset({"encoder-frozen", "encoder-reversed", "encoder-scale"})
"""Faults that the encoder hides: the host must know from torque, see `unseen`."""
LEAPS = frozenset({"encoder-jump", "second-master"})
"""Faults after which the drive's own stop begins with a leap."""
TELLING = 4.0
"""Gain of an encoder (or its inverse) up to which no torque tells it from another load."""
LOST_CYCLES = 3
"""Cycles in a row that a host may lose (`lost_cycles` of the profiles) if its recording tells them as missed."""
LOUD = frozenset(
    {
        "encoder-counts",
        "encoder-frozen",
        "encoder-reversed",
        "encoder-scale",
        "stop-fault",
        "drive-fault",
        "following-error",
        "silent",
        "power-loss",
        "enable-missing",
        "brake-missing",
        "hot",
        "blocked",
        "rpdo-lost",
        "second-master",
        "status-word",
        "unplugged",
        "runaway",
        "torque-reversed",
    }
)
"""Faults with which a run must not end as if nothing had happened, once they have had an effect."""
