"""Jobs done for real on a simulated drive, without processes: idle inputs, and commits that a person approves."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.testclient import TestClient

from autotune.core.axis import read_axis
from autotune.core.errors import LinkError
from autotune.core.loop import LocalLoop
from autotune.models.model_file import parse_model, read_model, write_model
from autotune.service import work
from autotune.service.access import AccessGuard, Rules
from autotune.service.api import make_api
from autotune.service.inline import Ended, do_at_once
from autotune.service.orders import Order
from autotune.service.work import Tools
from autotune.tuning.ending import KEPT, KeptBut
from autotune.tuning.outcome import Outcome, RunResult
from autotune.tuning.progress import Silent
from autotune.tuning.proof import TrackingError
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset
from tests.service.conftest import START, left_kept, write_axis

World = Any
AUTH = {"Authorization": "Bearer a-token-that-is-long-enough"}
ENABLED = "feedforward.enabled"


@dataclass
class RealLauncher:
    """Does each job at once, on a drive whose memory is a file."""

    memory: Path
    clock: Callable[[], Any]
    ended: list[Ended] = field(default_factory=list)

    def start(self, order: Order) -> Ended:
        def loop() -> LocalLoop:
            return LocalLoop(SimDrive(preset("edm-vertical"), len(self.ended) + 1, self.memory))

        tools = Tools(read_axis(order.file), loop, Silent(), self.clock)
        self.ended.append(do_at_once(order, tools))
        return self.ended[-1]

    def held(self) -> dict[str, float]:
        """What the drive has stored."""
        drive = SimDrive(preset("edm-vertical"), 0, self.memory)
        found = drive.read_parameters()
        drive.close()
        return found


@dataclass
class Real:
    """A service, its launcher, and a client with the token."""

    world: World
    launcher: RealLauncher
    client: TestClient

    def job(self, kind: str, **wish: Any) -> dict[str, Any]:
        """Has a job done, and returns it."""
        answer = self.client.post("/api/axes/one/jobs", json={"kind": kind, **wish}, headers=AUTH)
        assert answer.status_code == 202, answer.text
        return self.done(answer.json()["id"])

    def done(self, identifier: str) -> dict[str, Any]:
        for _ in range(4):
            self.world.pass_time(seconds=1)
            self.world.manager.tick()
        found: dict[str, Any] = self.client.get(f"/api/jobs/{identifier}").json()
        return found


@pytest.fixture
def real(world: Callable[..., World], tmp_path: Path) -> Iterator[Callable[[str], Real]]:
    clients: list[TestClient] = []

    def make(extra: str) -> Real:
        here: World = None
        launcher = RealLauncher(tmp_path / "memory.json", lambda: here.now)
        here = world(["one"], extra=extra, launcher=launcher)
        rules = Rules("a-token-that-is-long-enough", False, frozenset({"127.0.0.1"}), 65536, 300.0)
        client = TestClient(AccessGuard(make_api(here.manager), rules), base_url="http://127.0.0.1")
        clients.append(client)
        return Real(here, launcher, client)

    yield make
    for client in clients:
        client.close()


def test_a_job_waits_until_the_input_of_the_drive_says_idle(real: Callable[[str], Real]) -> None:
    here = real(f'[axes.idle]\nby = "input"\ninput = "{ENABLED}"\nmask = 1')
    waiting = here.job("check")
    assert waiting["state"] == "queued"
    assert f"{ENABLED} is 0" in waiting["waits_for"]
    drive = SimDrive(preset("edm-vertical"), 0, here.launcher.memory)
    drive.write_parameters({ENABLED: 1.0})
    drive.store()
    drive.close()
    assert here.done(waiting["id"])["state"] == "queued", "it is not asked again at once"
    here.world.pass_time(minutes=6)
    assert here.done(waiting["id"])["outcome"] == "done"
    assert len(here.client.get("/api/axes/one/checks").json()) == 1


def test_an_input_that_the_drive_does_not_have_is_said(real: Callable[[str], Real]) -> None:
    row = real('[axes.idle]\nby = "input"\ninput = "digital.none"').job("check")
    assert row["outcome"] == "refused"
    assert "digital.none" in row["sentence"]


def error(peak: float) -> TrackingError:
    return TrackingError(peak, peak, peak)


def order(tmp_path: Path, kind: str = "commit") -> tuple[Order, Tools]:
    """A job on an axis whose drive is never opened."""
    runs = tmp_path / "runs"
    runs.mkdir()
    axis, options = read_axis(write_axis(tmp_path, "one")), {"proposal": "proved"}
    tools = Tools(axis, lambda: pytest.fail("opened"), Silent(), lambda: START)
    return Order("a" * 32, "one", kind, "one.toml", str(runs), options), tools


FRICTION, RIPPLE = {"feedforward.coulomb": 0.3}, {"feedforward.ripple.gain": 1.0}
LUGRE = ["inertia", "viscous", "coulomb", "break_away", "stiffness", "micro_damping", "offset"]
PART = {"drive": dict.fromkeys(LUGRE, 1.0), "host": ["presliding"], "predicted_peak_error": 0.6}
LESS = PART | {"drive": {"inertia": 1.0, "coulomb": 0.3}, "host": []}
"""Of a drive that knows no presliding: how much its part gives was predicted, and never measured before."""


@pytest.mark.parametrize(
    ("held", "reduction", "alone", "with_host", "outcome"),
    [
        (FRICTION, {}, 0.5, None, "kept"),
        (FRICTION, {}, 0.9, None, "rolled_back"),
        (FRICTION, PART, 0.9, 0.2, "kept"),
        (FRICTION, PART, 0.9, 0.8, "rolled_back"),
        (FRICTION, PART | {"host": []}, 0.75, None, "kept"),
        (FRICTION, PART | {"host": []}, 0.85, None, "rolled_back"),
        (FRICTION, LESS, 0.85, None, "kept"),  # of 0.4 that were predicted less than half; 0.1 are asked for
        (FRICTION, LESS, 0.95, None, "rolled_back"),
        (RIPPLE, {}, 1.0, None, "kept"),
        (FRICTION | RIPPLE, {}, 0.9, None, "rolled_back"),
    ],
)
def test_an_approved_commit_stays_where_it_gives_what_was_proved_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held: dict[str, float], reduction: dict[str, Any],
    alone: float, with_host: float | None, outcome: str,
) -> None:  # fmt: skip
    asked, tools = order(tmp_path)
    proved = Path(asked.runs, "proved")
    proved.mkdir()
    content = {"before": {"peak_error": 1.0}, "after": {"peak_error": 0.2}, "reduction": reduction}
    (proved / "run.json").write_text(json.dumps(content))
    result = RunResult(
        Outcome.KEPT, "Kept.", "one", "f", "", 0.0, proved, feedforward=held, committed=error(alone),
        with_host=error(with_host) if with_host is not None else None,
    )  # fmt: skip
    monkeypatch.setattr(work, "latest_run", lambda *_: proved)
    monkeypatch.setattr(work, "tune", lambda request: result)
    monkeypatch.setattr(work, "roll_back", lambda *_: SimpleNamespace(id="b"))
    assert work.perform(asked, tools).outcome == outcome


@pytest.mark.parametrize("kind", ["run", "commit"])
def test_what_goes_wrong_after_a_commit_was_kept_makes_no_fault_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    asked, tools = order(tmp_path, kind)
    left = left_kept(Path(asked.runs), asked.id)
    (left / "run.json").write_text("{}")

    def kept_but(request: object) -> None:
        raise KeptBut(f"{KEPT}: the link is gone", LinkError.exit_code)

    monkeypatch.setattr(work, "latest_run", lambda *_: Path("proved"))
    monkeypatch.setattr(work, "read_json", lambda *_: {})
    monkeypatch.setattr(work, "tune", kept_but)
    done = work.perform(asked, tools)
    assert (done.outcome, done.run) == ("kept", left.name)
    assert done.sentence.endswith("after that: the link is gone")


@pytest.mark.long
def test_what_was_proved_is_written_only_when_a_person_approves(real: Callable[[str], Real]) -> None:
    here = real('commit = "ask"')
    ran = here.job("run")
    assert (ran["outcome"], ran["exit_code"]) == ("not_applied", 3), ran
    assert not here.launcher.held()[ENABLED]
    (proposal,) = here.client.get("/api/proposals").json()
    assert (proposal["state"], proposal["run"]) == ("open", ran["run"])
    assert here.world.notices[-1]["kind"] == "proposal"
    refused = here.client.post(f"/api/proposals/{proposal['id']}/approve")
    assert refused.status_code == 401
    assert not here.launcher.held()[ENABLED]

    approved = here.client.post(f"/api/proposals/{proposal['id']}/approve", headers=AUTH)
    assert approved.status_code == 202
    committed = here.done(approved.json()["id"])
    assert (committed["kind"], committed["outcome"]) == ("commit", "kept"), committed
    assert here.launcher.held()[ENABLED] == 1.0
    assert here.client.get("/api/proposals").json()[0]["state"] == "approved"
    assert here.client.post(f"/api/proposals/{proposal['id']}/reject", headers=AUTH).status_code == 409

    restored = here.job("rollback")
    assert restored["outcome"] == "restored"
    assert not here.launcher.held()[ENABLED]


@pytest.mark.long
def test_what_a_diagnosis_leaves_in_doubt_is_played_and_its_recording_is_there(
    real: Callable[[str], Real],
) -> None:
    here = real("")
    before = here.launcher.held()
    row = here.job("decide", effects=["spring", "gravity_imbalance"])
    assert (row["outcome"], row["exit_code"]) == ("done", 0), row
    assert "spring, gravity imbalance: diagnose again" in row["sentence"]
    (found,) = here.client.get("/api/axes/one/recordings").json()
    assert (found["run"], found["name"]) == (row["run"], "decide")
    taken = here.client.post(f"/api/workbench/from-run/{found['id']}", headers=AUTH)
    assert taken.status_code == 200, taken.text
    assert taken.json()["axis"] == "one"
    assert taken.json()["seconds"] < 70.0
    assert here.launcher.held() == before


@pytest.mark.long
def test_a_model_that_was_made_elsewhere_goes_to_the_axis_through_the_proof(
    real: Callable[[str], Real],
) -> None:
    """The model of an earlier run, a little changed by hand; and one of another axis, which nothing moves for."""
    here = real('commit = "ask"')
    runs = here.world.manager.configuration.runs
    before = here.launcher.held()
    first = here.job("run")
    model = replace_value(runs / first["run"] / "model.toml", "inertia", 1.02)
    sent = here.job("run", model=model)
    assert (sent["outcome"], sent["exit_code"]) == ("not_applied", 3), sent
    assert [one["state"] for one in here.client.get("/api/proposals").json()].count("open") == 1
    assert here.launcher.held() == before, "a person was not asked yet"
    found = json.loads((runs / sent["run"] / "run.json").read_text())
    assert any("stands in place of the diagnosed one" in note for note in found["notes"])
    assert read_model(runs / sent["run"] / "model.toml").parameters == parse_model(model).parameters
    fingerprint = parse_model(model).fingerprint
    foreign = here.job("run", model=model.replace(fingerprint, "0" * len(fingerprint)))
    assert (foreign["outcome"], foreign["run"]) == ("refused", None)
    assert "fit one from recordings of this axis" in foreign["sentence"]


def replace_value(path: Path, name: str, factor: float) -> str:
    """A model file's text with one number changed."""
    known = read_model(path)
    value = known.parameters[name]
    changed = known.with_values({name: value.value * factor})
    write_model(changed, path.with_name("changed.toml"))
    return path.with_name("changed.toml").read_text()
