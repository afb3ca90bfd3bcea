"""Fuzzing configuration, what runs leave on disk, and requests to the service."""

from __future__ import annotations

import asyncio
import json
import math
import random
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from autotune.core.axis import read_axis
from autotune.tuning.backup import load_backup
from autotune.tuning.files import checksum
from autotune.tuning.findings import load_findings
from autotune.tuning.journal import Journal
from autotune_drivers.moteus.profile import read_moteus_profile
from autotune_drivers.profile import read_profile
from bench.fuzz_judging import CORPUS, refused, require
from bench.fuzz_mutation import changed_tree, mutated, toml_text


def _numbers_finite(values: Any) -> None:
    """No number in a tree of plain values is nan or infinite."""
    if isinstance(values, float):
        require(math.isfinite(values), f"accepted {values}")
    elif isinstance(values, Mapping):
        for value in values.values():
            _numbers_finite(value)
    elif isinstance(values, (list, tuple)):
        for value in values:
            _numbers_finite(value)


def toml_kind(read: Callable[[Path], Any], dump: Callable[[Any], Any]) -> Callable[[bytes, Path], bool]:
    def run(data: bytes, folder: Path) -> bool:
        path = folder / "some.toml"
        path.write_bytes(data)
        failed, found = refused(lambda: read(path))
        if not failed:
            _numbers_finite(dump(found))
        return not failed

    return run


def read_any_profile(path: Path) -> Any:
    moteus = b"moteus" in path.read_bytes()
    return read_moteus_profile(str(path)) if moteus else read_profile(str(path))


def make_toml(chance: random.Random, seeds: list[bytes]) -> bytes:
    if chance.random() < 0.5:
        return mutated(chance, seeds)
    import tomllib

    tree = tomllib.loads(chance.choice(seeds).decode())
    return toml_text(changed_tree(chance, tree)).encode("utf-8", "replace")


def make_json(chance: random.Random, seeds: list[bytes]) -> bytes:
    if chance.random() < 0.4:
        return mutated(chance, seeds)
    tree = changed_tree(chance, json.loads(chance.choice(seeds)))
    if "checksum" in tree and chance.random() < 0.8:
        tree.pop("checksum")
        try:
            tree["checksum"] = checksum(tree)
        except ValueError:
            tree["checksum"] = ""
    return json.dumps(tree).encode("utf-8", "replace")


def read_journal(data: bytes, folder: Path) -> bool:
    (folder / "journal.json").write_bytes(data)
    failed, journal = refused(lambda: Journal.load(folder))
    if not failed:
        for values in (journal.state.changed, journal.state.written):
            require(
                all(type(value) in (int, float) and math.isfinite(value) for value in values.values()),
                f"{values}",
            )
        require(isinstance(journal.state.axis, str) and isinstance(journal.state.outcome, str), "texts")
    return not failed


def read_backup(data: bytes, folder: Path) -> bool:
    place = folder / "backups" / "z"
    place.mkdir(parents=True, exist_ok=True)
    (place / "20260501-120000-1.json").write_bytes(data)
    failed, backup = refused(lambda: load_backup(folder, "z", "20260501-120000-1"))
    if not failed:
        _numbers_finite(dict(backup.parameters))
        require(all(type(value) in (int, float) for value in backup.parameters.values()), f"{backup}")
    return not failed


def read_findings(data: bytes, folder: Path) -> bool:
    axis = _axis()
    run = folder / f"20260501-120000-{axis.name}"
    run.mkdir(exist_ok=True)
    (run / "findings.json").write_bytes(data)
    if not (run / "journal.json").exists():
        Journal.begin(run, axis.name, axis.fingerprint, datetime(2026, 5, 1, 12))
    failed, found = refused(lambda: load_findings(folder, axis, "commit"))
    if not failed and found.proposed is not None:
        require(bool(np.all(np.isfinite(found.proposed.array()))), f"{found.proposed}")
    if not failed and found.planned is not None:
        require(
            all(type(v) in (int, float) and math.isfinite(v) for v in found.planned.values.values()),
            "planned",
        )
    return not failed


def _axis() -> Any:
    if not _KEPT:
        _KEPT.append(read_axis(CORPUS / "axis" / "edm-vertical.toml"))
    return _KEPT[0]


_KEPT: list[Any] = []


class _Service:
    """A manager that knows one axis, notes what it is asked to do, and does nothing."""

    def __init__(self) -> None:
        self.asked: list[tuple[Any, ...]] = []
        self.store = self.configuration = self
        self.axes: tuple[Any, ...] = ()
        self.runs = Path("/nonexistent")

    def axis(self, name: str) -> Any:
        return self if name == "one" else None

    name = "one"

    def permit(self, axis: str, minutes: float) -> None:
        self.asked.append((axis, minutes))
        raise _Noted

    def submit(self, axis: str, kind: str, origin: str, options: dict[str, Any]) -> None:
        self.asked.append((axis, kind, origin, options))


class _Noted(Exception):
    """Instead of an answer that would need a real service."""


def read_api(data: bytes, folder: Path) -> bool:
    from autotune.service.access import AccessGuard, Rules
    from autotune.service.api import make_api

    if not _APPS:
        service = _Service()
        rules = Rules("t" * 32, False, frozenset({"127.0.0.1"}), 4096, 5.0)
        _APPS.extend([AccessGuard(make_api(service), rules), service, asyncio.new_event_loop()])  # type: ignore[arg-type]
    app, service, loop = _APPS
    service.asked.clear()
    put = b"minutes" in data
    status = loop.run_until_complete(
        _asked(app, "PUT" if put else "POST", "/api/axes/one/" + ("idle" if put else "jobs"), data)
    )
    require(status == 0 or 400 <= status < 500, f"status {status}")
    for asked in service.asked:
        minutes = asked[1] if len(asked) == 2 else 0.0
        require(not isinstance(minutes, (int, float)) or 0 <= minutes <= 7 * 24 * 60, f"{asked}")
        require(len(asked) == 2 or asked[1] in ("check", "run", "rollback"), f"{asked}")
    return bool(service.asked)


_APPS: list[Any] = []


async def _asked(app: Any, method: str, path: str, body: bytes) -> int:
    """The status of one request; 0 where the service would have done what was asked."""
    headers = [
        (b"host", b"127.0.0.1"),
        (b"content-length", str(len(body)).encode()),
        (b"content-type", b"application/json"),
        (b"authorization", b"Bearer " + b"t" * 32),
    ]
    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": method, "path": path,
        "raw_path": path.encode(), "query_string": b"", "headers": headers, "scheme": "http", "root_path": "",
        "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 80), "state": {},
    }  # fmt: skip
    statuses: list[int] = []
    parts = [{"type": "http.request", "body": body, "more_body": False}, {"type": "http.disconnect"}]

    async def receive() -> dict[str, Any]:
        return parts.pop(0) if len(parts) > 1 else parts[0]

    async def send(message: dict[str, Any]) -> None:
        if message["type"] == "http.response.start":
            statuses.append(message["status"])

    try:
        await app(scope, receive, send)
    except _Noted:
        return 0
    return statuses[0] if statuses else 599


def service_file(path: Path) -> Any:
    from autotune.core.configuration import read_toml, validate
    from autotune.service.settings import Service

    return validate(Service, read_toml(path, "service file"), f"service file {path}")
