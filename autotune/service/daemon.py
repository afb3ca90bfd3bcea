"""`autotune serve`: starts everything in order, then one round after the other until a signal ends it.

SIGTERM and SIGINT let running jobs come to rest; SIGHUP reads the configuration again.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime, timedelta
from pathlib import Path
from types import FrameType

from sqlalchemy.exc import SQLAlchemyError

from autotune.core.errors import AutotuneError, ConfigurationError, LinkError
from autotune.service import housekeeping, systemd
from autotune.service.database import Opened, back_up, open_database, shown
from autotune.service.launcher import ProcessLauncher, place_for_kernels
from autotune.service.live_hub import LiveHubs
from autotune.service.lock_file import Lock
from autotune.service.manager import Manager, plans_of
from autotune.service.notices import Webhook
from autotune.service.ownership import take
from autotune.service.schedule import Schedule
from autotune.service.server import HttpServer, listen
from autotune.service.service_file import port_file, token_file, token_of, write_own
from autotune.service.settings import Configuration, read_service, remember_checkable
from autotune.service.store import Store
from autotune.service.taking_up import absorb
from autotune.tuning.files import file_lock

ROUND_SECONDS = 0.25
UPKEEP_SECONDS = 300.0
BACKUP_EVERY = timedelta(hours=20)
OWNING_EVERY = 2.0
ENDING_SECONDS = 40.0
OTHERS = 0o027
"""umask: what the service and its jobs write is theirs, and their group's to read."""
log = logging.getLogger("autotune.service")
Say = Callable[[str], None]


class Owners:
    """The service's hold on the links of its axes, each once; what another program has is tried again."""

    def __init__(self) -> None:
        self._held: dict[str, Lock] = {}
        self._axes: dict[str, str] = {}
        self._complained: set[str] = set()

    def holds(self, axis: str) -> bool:
        """The service may use this axis."""
        return self._axes.get(axis) in self._held

    def ensure(self, configuration: Configuration, busy: set[str]) -> None:
        """Takes what is free, lets go of what is not in the configuration any more and at rest."""
        moving = {self._axes[name] for name in busy if name in self._axes}
        kept = {name: bus for name, bus in self._axes.items() if name in busy}
        self._axes = {one.name: one.bus for one in configuration.axes} | kept
        for bus in set(self._held) - set(self._axes.values()) - moving:
            self._held.pop(bus).release()
        for name, bus in self._axes.items():
            if bus not in self._held:
                self._try(name, bus)

    def _try(self, name: str, bus: str) -> None:
        try:
            self._held[bus] = take(bus, name, "autotune serve")
            self._complained.discard(name)
        except ConfigurationError as error:
            if name not in self._complained:
                self._complained.add(name)
                log.warning("%s; its jobs wait", error)

    def release(self) -> None:
        """Lets go of all."""
        for held in self._held.values():
            held.release()
        self._held.clear()


class Upkeep:
    """What the folders hold taken up into the history, then disk budget and backups, now and then."""

    def __init__(self, opened: Opened, store: Store) -> None:
        self._opened, self._store, self._taken_up = opened, store, False

    def take_up(self, configuration: Configuration) -> str:
        """Takes up runs and checks that the history lacks, until that has succeeded once; a problem in words or ""."""
        if self._taken_up:
            return ""
        try:
            taken = absorb(self._store, configuration.runs)
        except (SQLAlchemyError, OSError) as error:
            return f"runs and checks cannot be taken up into the history: {str(error).splitlines()[0]}"
        self._taken_up = True
        if taken:
            log.info("%d runs and checks in %s taken up into the history", taken, configuration.runs)
        return ""

    def run(self, configuration: Configuration, now: datetime) -> list[str]:
        """Prunes and backs up; returns problems in words."""
        untaken = self.take_up(configuration)
        problems = [untaken] if untaken else []
        try:
            budget = configuration.service.recordings.budget_megabytes * housekeeping.MEGABYTE
            axes = [one.name for one in configuration.axes]
            for path in housekeeping.prune(configuration.runs, axes, budget):
                log.info("recordings of %s removed for room", path.name)
        except OSError as error:
            problems.append(f"recordings cannot be removed: {error}")
        if self._opened.file is None:
            return problems
        folder = configuration.state / "backups"
        backups = sorted(folder.glob("history-*.sqlite"))
        newest = backups[-1].stat().st_mtime if backups else 0.0
        if abs(now.timestamp() - newest) > BACKUP_EVERY.total_seconds():
            try:
                back_up(self._opened.file, folder, now, configuration.service.history.backups)
            except Exception as error:  # noqa: BLE001 - whatever it is, the service goes on and says so
                problems.append(f"the history cannot be backed up: {error}")
        return problems


class _Signals:
    """What signals have asked for."""

    def __init__(self) -> None:
        self.end = threading.Event()
        self.reload = threading.Event()

    def install(self) -> None:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end)
        signal.signal(signal.SIGHUP, self._reload)

    def _end(self, number: int, frame: FrameType | None) -> None:
        self.end.set()

    def _reload(self, number: int, frame: FrameType | None) -> None:
        self.reload.set()


def serve(file: Path, announce: Say) -> None:
    """Serves until a signal ends it.

    Raises:
        ConfigurationError, LinkError: nothing was started.
    """
    os.umask(os.umask(0o077) | OTHERS)
    logging.basicConfig(level=logging.INFO)
    journal = systemd.to_journal()
    formatter = (
        systemd.JournalFormatter("%(message)s")
        if journal
        else systemd.CleanFormatter("%(levelname)s %(message)s")
    )
    logging.getLogger().handlers[0].setFormatter(formatter)
    for chatty in ("alembic", "apscheduler", "uvicorn"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
    configuration = read_service(file)
    signals = _Signals()
    with _alone(configuration.state):
        remember_checkable(configuration)
        place_for_kernels(configuration.state)
        listening = listen(configuration.service.http)
        try:
            now = datetime.now().astimezone()
            backups = configuration.state / "backups"
            opened = open_database(
                configuration.history_url, backups, now, configuration.service.history.backups
            )
        except BaseException:
            listening.close()
            raise
        signals.install()
        try:
            _serve(configuration, opened, listening, signals, announce)
        except SQLAlchemyError as error:
            reason = str(getattr(error, "orig", None) or error).splitlines()[0]
            raise LinkError(
                f"the history {shown(configuration.history_url)} cannot be used: {reason}"
            ) from error


def _serve(
    configuration: Configuration, opened: Opened, listening: socket.socket, signals: _Signals, announce: Say
) -> None:
    store = Store(opened.engine)
    webhook = Webhook(configuration.service.notices)
    schedule = Schedule(opened.engine, plans_of(configuration), datetime.now().astimezone())
    hubs = LiveHubs()
    manager = Manager(
        configuration, store, schedule, ProcessLauncher(hubs), webhook.tell,
        lambda: datetime.now().astimezone(), time.monotonic, hubs,
    )  # fmt: skip
    server = HttpServer(manager, configuration.service.http, token_of(configuration.state), listening)
    owners = Owners()
    manager.owns = owners.holds
    try:
        owners.ensure(configuration, set())
        if opened.restored:
            manager.say_restored(opened.restored)
        upkeep = Upkeep(opened, store)
        manager.set_problem("upkeep", upkeep.take_up(configuration))
        manager.tick()
        server.start()
        _note_port(configuration, server.port)
        announce(server.address)
        _introduce(configuration)
        systemd.notify(f"READY=1\nSTATUS=serving at {server.address}")
        _rounds(manager, server, owners, upkeep, webhook, signals)
    finally:
        systemd.notify("STOPPING=1")
        _end(manager)
        server.close()
        port_file(configuration.state).unlink(missing_ok=True)
        owners.release()
        schedule.close()
        webhook.close()
        store.close()


def _note_port(configuration: Configuration, port: int) -> None:
    """Where the system has chosen the port, the command line finds it; without it the service does its work too."""
    if configuration.service.http.port:
        return
    try:
        write_own(port_file(configuration.state), f"{port}\n", 0o644)
    except OSError as error:
        log.warning("the port cannot be noted for the command line: %s", error)


def _introduce(configuration: Configuration) -> None:
    """What is looked after, by which file, and where the token is."""
    names = ", ".join(f"{one.name} (commit: {one.settings.commit})" for one in configuration.axes)
    log.info("axes: %s; changes need the token in %s", names, token_file(configuration.state))
    if not configuration.service.http.loopback:
        log.warning(
            "other machines reach %s: put a proxy with TLS in front, or the token crosses the network as it is",
            configuration.service.http.host,
        )


def _rounds(
    manager: Manager, server: HttpServer, owners: Owners, upkeep: Upkeep, webhook: Webhook, signals: _Signals
) -> None:
    next_upkeep = next_owning = time.monotonic()
    while not signals.end.wait(ROUND_SECONDS):
        if signals.reload.is_set():
            signals.reload.clear()
            _reload(manager)
            webhook.change(manager.configuration.service.notices)
            next_owning = 0.0
        manager.tick()
        manager.health.notices_lost = webhook.lost
        now = time.monotonic()
        if now >= next_owning:
            owners.ensure(manager.configuration, {one.axis.name for one in manager.running.values()})
            next_owning = now + OWNING_EVERY
        if now >= next_upkeep:
            problems = upkeep.run(manager.configuration, datetime.now().astimezone())
            manager.set_problem("upkeep", "; ".join(problems))
            manager.health.recordings_bytes = housekeeping.used(manager.configuration.runs)
            next_upkeep = now + UPKEEP_SECONDS
        if server.alive:
            systemd.notify("WATCHDOG=1")


def _reload(manager: Manager) -> None:
    """A file that is wrong, or a history that does not take it, changes nothing and is said loudly."""
    systemd.notify("RELOADING=1")
    try:
        fresh = read_service(manager.configuration.file)
        old = manager.configuration
        if (fresh.service.http, fresh.runs, fresh.history_url) != (
            old.service.http,
            old.runs,
            old.history_url,
        ):
            log.warning("changes of http, runs and history need a restart; the rest is taken over")
        remember_checkable(fresh)
        manager.reload(fresh)
        log.info("configuration read again: %s", ", ".join(one.name for one in fresh.axes))
    except (AutotuneError, SQLAlchemyError, OSError) as error:
        log.error("configuration not taken over, the old one stays in force: %s", error)
    systemd.notify("READY=1")


def _end(manager: Manager) -> None:
    """Running jobs come to rest; what does not end in time is left to its own lifeline."""
    manager.shut_down()
    deadline = time.monotonic() + ENDING_SECONDS
    while not manager.idle and time.monotonic() < deadline:
        time.sleep(0.05)


@contextmanager
def _alone(state: Path) -> Iterator[None]:
    """One service a runs folder.

    Raises:
        ConfigurationError: another one is there, or the folder cannot be used.
    """
    taken = f"a service with the folder {state.parent} is running already (process {{owner}})"
    with suppress(FileNotFoundError, PermissionError):
        state.chmod(state.stat().st_mode & 0o750)
    with file_lock(state / "lock", unusable="set 'runs' in the service file to one that can", taken=taken):
        yield
