"""A whole session beside a master: model, drive, checks, play, and everything put back whatever happens."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from autotune.control.model_feedforward import ModelFeedforward
from autotune.control.reduction import DrivePart
from autotune.control.torque_offset import Phase
from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError, Interrupted, LinkError, StateError
from autotune.tuning.links import SESSIONS
from autotune.tuning.play import Laws, Player
from autotune.tuning.play_metrics import EVERY, PlayMetrics
from autotune.tuning.play_model import HostModel, host_model, must_be_tuned_drive
from autotune.tuning.run_directory import axis_lock
from autotune_drivers.canopen.opening import LINKS
from autotune_drivers.canopen.sidecar import Sidecar, open_sidecar
from autotune_drivers.profile import Profile, read_profile
from autotune_drivers.url import parse_link


@dataclass(frozen=True, slots=True)
class PlayRequest:
    """What is asked for: an axis, its file's folder, the folder of all runs; a metrics file or none."""

    axis: Axis
    directory: Path
    runs: Path
    metrics: Path | None = None


def play_axis(request: PlayRequest, stop: Callable[[], bool], say: Callable[[str], None]) -> None:
    """Plays until `stop()`; always ends with an error that says why.

    Raises:
        Interrupted: `stop` was asked for. StateError: a doubt. ConfigurationError, LinkError: see `open_sidecar`.
    """
    axis = request.axis
    profile = _profile(request)
    tuned = host_model(request.runs, axis)
    address = parse_link(axis.link, request.directory)
    keep = request.runs.resolve() / SESSIONS / axis.name
    with axis_lock(request.runs, axis.name):
        link = LINKS[address.scheme](address)
        try:
            sidecar = open_sidecar(link, address.options["node"], axis, profile, keep)
            must_be_tuned_drive(tuned, sidecar.identity)
            laws = _laws(tuned, sidecar, axis)
        except BaseException:
            link.close()
            raise
        for sentence in sidecar.left:
            say(sentence)
        metrics = PlayMetrics(request.metrics, axis.name) if request.metrics else None
        _beside(sidecar, Player(sidecar, axis, laws), metrics, stop, say)


def _profile(request: PlayRequest) -> Profile:
    scheme = request.axis.link.partition(":")[0]
    if scheme not in LINKS:
        raise ConfigurationError(
            f"link {request.axis.link!r} is no CANopen bus; 'play' needs an adapter of its own on the bus of the "
            f"master ({', '.join(LINKS)})"
        )
    profile = read_profile(request.axis.profile, request.directory)
    if profile.ripple is not None:
        raise ConfigurationError(
            f"profile {profile.name!r} lets the drive play ripple, which 'play' cannot tell apart from what the host "
            "has to play; export the model to the master instead ('autotune export')"
        )
    return profile


def _laws(tuned: HostModel, sidecar: Sidecar, axis: Axis) -> Laws:
    whole = ModelFeedforward(tuned.model, axis.cycle)
    share = sidecar.own_share()
    own = DrivePart(share, axis.cycle) if share is not None else None
    for law in (whole, own):
        if law is not None:
            law.prepare()
    return Laws(whole, own, tuned.model.base["inertia"].value)


def _beside(
    sidecar: Sidecar,
    player: Player,
    metrics: PlayMetrics | None,
    stop: Callable[[], bool],
    say: Callable[[str], None],
) -> None:
    """Prepares the drive, plays, and puts everything back."""
    troubles: list[str] = []
    try:
        if metrics is not None:
            metrics.write(player)
        sidecar.prepare()
        say(
            "watching the master's set points; the offset is faded in once the first moves fit the model. Should this "
            f"program die, the drive drops it within {sidecar.gone_within * 1e3:g} ms"
        )
        _play(player, metrics, stop, say)
    finally:
        troubles = sidecar.close(player.dropped)
    if metrics is not None:
        metrics.keep_up(player, say)
    if troubles:
        raise LinkError(
            f"{_ending(player)}; {'; '.join(troubles)}. Start 'autotune play' again, which tries once more"
        )
    if player.reason:
        raise StateError(f"{_ending(player)}; the drive's settings are as before")
    raise Interrupted("stopped: the offset is out, the drive's settings are as before")


def _ending(player: Player) -> str:
    return f"the offset was taken out: {player.reason}" if player.reason else "stopped"


def _play(
    player: Player, metrics: PlayMetrics | None, stop: Callable[[], bool], say: Callable[[str], None]
) -> None:
    due, phase = time.monotonic(), player.offset.phase
    while not player.ended:
        player.turn()
        if stop():
            player.leave()
        if player.offset.phase is not phase:
            phase = player.offset.phase
            say("playing: the model fits, the offset is faded in" if phase is Phase.PLAYING else "fading out")
        if metrics is not None and time.monotonic() >= due:
            due = time.monotonic() + EVERY
            metrics.keep_up(player, say)
