"""Opens a moteus controller on a serial line: who answers, is it the one expected, is it free.

Nothing is written before all of that has been checked.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError, IdentityMismatch, StateError, TransferAborted
from autotune.core.stopping import StopLimits
from autotune_drivers.kept import Keeper
from autotune_drivers.moteus.drive import TURN, MoteusDrive
from autotune_drivers.moteus.exchange import MoteusExchange
from autotune_drivers.moteus.faults import UNCOMMANDED, mode_text
from autotune_drivers.moteus.multiplex import (
    FIRMWARE_VERSION,
    MAP_VERSION,
    MODE,
    MODEL,
    SERIAL_NUMBER,
    Form,
)
from autotune_drivers.moteus.node import MoteusNode
from autotune_drivers.moteus.port import MoteusPort, open_port
from autotune_drivers.moteus.power import MoteusPower
from autotune_drivers.moteus.profile import UNITS, MoteusProfile
from autotune_drivers.moteus.settings import MoteusSettings, put_right
from autotune_drivers.url import LinkAddress

_FREE_WITHIN = 2.0
_LOOK = 0.05
_SIGN = "servo.pid_position.sign"
_LIMITS = {
    "limit.position_min": "position_min",
    "limit.position_max": "position_max",
    "limit.speed": "speed",
    "limit.following_error": "following_error",
    "limit.temperature": "temperature",
}


@dataclass(frozen=True, slots=True)
class MoteusOpener:
    """Opens the controller of an axis; picklable, so that the cyclic process can call it.

    `keep`: folder for what is changed in the controller, see `kept`.
    """

    address: LinkAddress
    axis: Axis
    profile: MoteusProfile
    keep: Path | None = None

    def __call__(self, backup: Mapping[str, str] | None = None) -> MoteusDrive:
        """Opens port and controller; `backup` is what an earlier session left to be put back.

        Raises:
            LinkError: nobody there, the wrong controller. StateError: another program has it.
            ConfigurationError: an axis that a moteus cannot have.
        """
        if self.axis.motion_unit != "rad":
            raise ConfigurationError(
                f"axis {self.axis.name} counts metres, but a moteus counts revolutions; set motion_unit to 'rad'"
            )
        port = open_port(Path(self.address.target), self.address.options["baud"])
        try:
            number = self.address.options["id"]
            return open_controller(port, number, self.axis, self.profile, backup, self.keep)
        except BaseException:
            port.close()
            raise


def open_controller(
    port: MoteusPort,
    number: int,
    axis: Axis,
    profile: MoteusProfile,
    backup: Mapping[str, str] | None = None,
    keep: Path | None = None,
) -> MoteusDrive:
    """Checks the controller and prepares a session with it. The port stays the caller's if this raises.

    What an earlier session has left changed is put back first where it is in `keep`, else by this session.
    """
    node = MoteusNode(port, number)
    node.greet()
    identity = identify(node, profile)
    _compare(identity, profile, number)
    mode = _must_be_free(node)
    keeper = Keeper.of(keep, identity) if keep is not None else None
    inherited = backup if keeper is None else None
    settings = MoteusSettings(node, profile, axis.mechanics.direction, inherited, keeper)
    settings.parameters.find_absent()
    _must_be_there(settings, profile, number)
    left = put_right(settings.console, keeper) if keeper is not None else ()
    try:
        drive = _prepare(node, settings, axis, profile, identity, mode)
        drive.left = left
        return drive
    except BaseException:
        settings.restore()
        raise


def _prepare(
    node: MoteusNode,
    settings: MoteusSettings,
    axis: Axis,
    profile: MoteusProfile,
    identity: Mapping[str, int | str],
    mode: int,
) -> MoteusDrive:
    lock_step = _lock_step(settings, profile)
    exchange = MoteusExchange(
        node,
        profile.cycle,
        axis.cycle,
        lock_step,
        temperature=profile.temperature,
        torque=axis.limits.torque,
        watchdog=profile.guard.watchdog,
    )
    exchange.survey()
    power = MoteusPower(
        node.number,
        exchange,
        profile,
        limits=StopLimits.of(axis),
        deceleration=axis.limits.deceleration / TURN,
        speed=axis.limits.speed / TURN,
        scale=axis.mechanics.direction * TURN,
    )
    if mode not in (0, 1):
        exchange.stop(_LOOK)  # it holds for a host that is gone
    for name, text in _wanted(settings, axis, profile, lock_step).items():
        settings.change(name, text)
    sign = _sign(settings)
    return MoteusDrive(exchange, power, settings, axis, identity, lock_step, sign)


# Who is there


def identify(node: MoteusNode, profile: MoteusProfile) -> dict[str, int | str]:
    """Model, register map, serial number and firmware, as registers 100h to 122h have them."""
    values: dict[int, float] = {}
    for register in (MODEL, FIRMWARE_VERSION, MAP_VERSION):
        values |= node.registers((Form.INT32, register, 1))
    serial = node.registers((Form.INT32, SERIAL_NUMBER, 3))
    version = int(values.get(FIRMWARE_VERSION, 0))
    return {
        "vendor": profile.vendor,
        "product": int(values.get(MODEL, 0)),
        "revision": int(values.get(MAP_VERSION, 0)),
        "serial": "".join(f"{int(value) & 0xFFFFFFFF:08x}" for value in serial.values()),
        "name": profile.title,
        "firmware": f"{version >> 8}.{version & 0xFF}",
    }


def _compare(identity: Mapping[str, int | str], profile: MoteusProfile, number: int) -> None:
    wanted = profile.identity
    wrong = []
    if wanted.model is not None and identity["product"] != wanted.model:
        wrong.append(f"its model is {int(identity['product']):#06x}, the profile is for {wanted.model:#06x}")
    if not wanted.map_min <= int(identity["revision"]) <= wanted.map_max:
        wrong.append(
            f"its register map is version {identity['revision']}, the profile was checked with {wanted.map_min} "
            f"to {wanted.map_max}"
        )
    if wrong:
        raise IdentityMismatch(
            f"controller {number} is not one of profile {profile.name!r}: {'; '.join(wrong)}. Nothing was written. "
            "Choose the profile of this controller in the axis file"
        )


def _must_be_free(node: MoteusNode) -> int:
    """A commanded controller belongs to another program, or to one of ours that has just died; its mode."""
    end = time.monotonic() + _FREE_WITHIN
    while True:
        mode = int(node.registers((Form.INT8, MODE, 1))[MODE])
        if mode in UNCOMMANDED:
            return mode
        if time.monotonic() > end:
            raise StateError(
                f"controller {node.number} is already in {mode_text(mode)}: another program commands it. Nothing "
                "was written. Stop that program first"
            )
        time.sleep(_LOOK)


def _must_be_there(settings: MoteusSettings, profile: MoteusProfile, number: int) -> None:
    """Without its gains the controller is another one than the profile's."""
    absent = sorted(name for name in settings.parameters.absent if not name.startswith("limit."))
    if absent:
        raise IdentityMismatch(
            f"controller {number} has no {', '.join(absent)}, which profile {profile.name!r} names. Nothing was "
            "written. Choose the profile of this controller in the axis file"
        )


# What the session needs


def _lock_step(settings: MoteusSettings, profile: MoteusProfile) -> bool:
    """True where the controller says that its time advances with commands."""
    if profile.clock is None:
        return False
    try:
        return settings.console.number(profile.clock.lock_step) != 0.0
    except TransferAborted:
        return False


def _wanted(settings: MoteusSettings, axis: Axis, profile: MoteusProfile, lock_step: bool) -> dict[str, str]:
    """Settings for the session: the profile's, the stop's deceleration, and limits that are not there yet."""
    wanted = {name: f"{value:.9g}" for name, value in profile.session.items()}
    stop = profile.stop_deceleration
    if stop is not None:
        wanted[stop.at] = f"{axis.limits.deceleration / UNITS[stop.unit]:.9g}"
    if lock_step and profile.clock is not None:
        wanted[profile.clock.period] = f"{axis.cycle:.9g}"
    for name in settings.parameters.absent & set(_LIMITS):
        place = settings.parameters.where(name)
        wanted[place.at] = f"{getattr(axis.limits, _LIMITS[name]) / place.factor:.9g}"
    return wanted


def _sign(settings: MoteusSettings) -> float:
    """Of the position controller's torques; −1 in every firmware that does not say."""
    try:
        return math.copysign(1.0, settings.console.number(_SIGN))
    except TransferAborted:
        return -1.0
