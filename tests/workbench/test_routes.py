"""The workbench's addresses: the story of a model by HTTP, and what is refused in words."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from autotune.core.axis import read_axis
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Recording
from autotune.service.access import AccessGuard, Rules
from autotune.workbench import engine as engine_module
from autotune.workbench.engine import Engine, Job
from autotune.workbench.files import Files
from autotune.workbench.routes import make_app, workbench_routes
from tests.workbench.test_files import made

TOKEN = "secret"
HEADERS = {"Authorization": f"Bearer {TOKEN}"}
SCRIPTS = (
    "vendor/uPlot.iife.min.js", "workbench.js", "where.js", "overlay.js", "axes.js", "api.js", "plots.js", "numbers.js",
    "limits.js",
)  # fmt: skip


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    engine = Engine()
    rules = Rules(
        TOKEN, True, frozenset({"127.0.0.1"}), 100_000, 60.0, open_pages=True, most_upload=10_000_000
    )
    app = AccessGuard(make_app(Files(tmp_path / "held"), engine), rules)
    with TestClient(app, base_url="http://127.0.0.1", headers=HEADERS) as client:
        yield client
    engine.close()


def sent(client: TestClient, recording: Recording, folder: Path) -> dict[str, Any]:
    write_recording(recording, folder / "sent.parquet")
    answer = client.post(
        "/api/workbench/recordings?name=sent.parquet", content=(folder / "sent.parquet").read_bytes()
    )
    assert answer.status_code == 200, answer.text
    view: dict[str, Any] = answer.json()
    return view


def done(client: TestClient, **wish: Any) -> dict[str, Any]:
    job = client.post("/api/workbench/jobs", json=wish)
    assert job.status_code == 202, job.text
    for _ in range(3000):
        state: dict[str, Any] = client.get(f"/api/workbench/jobs/{job.json()['id']}").json()
        if state["state"] not in ("queued", "running"):
            return state
        time.sleep(0.05)
    raise AssertionError("the computation did not end")


@pytest.mark.slow
def test_a_recording_is_fitted_and_compared(client: TestClient, short: Recording, tmp_path: Path) -> None:
    view = sent(client, short, tmp_path)
    fitted = done(client, kind="fit", recordings=[view["id"]])
    assert fitted["state"] == "done", fitted["error"]
    model = fitted["answer"]["model"]
    assert "[inertia]" in model
    compared = done(client, kind="compare", recordings=[view["id"]], model=model)["answer"]
    rows = compared["rows"]
    assert {len(values) for values in rows.values()} == {len(rows["time"])}
    assert {"position", "velocity", "acceleration", "travel_since_reversal"} <= set(rows)
    assert compared["error_rms"] > 0.0
    left_out = done(client, kind="fit", recordings=[view["id"]], left_out=[[[0.0, 0.5]]])
    assert left_out["state"] in ("done", "failed")  # a fit of less, or why not; never another answer
    wrong = done(client, kind="add", recordings=[view["id"]], model=model, effects=["stribek"])
    assert wrong["state"] == "failed"
    assert "did you mean" in wrong["error"]


def test_what_a_recording_used_stands_beside_the_limits_of_its_axis(short: Recording, tmp_path: Path) -> None:
    axis = read_axis(Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml")
    engine = Engine()
    try:
        app = FastAPI()
        app.include_router(workbench_routes(Files(tmp_path / "held"), engine, [axis]))
        with TestClient(app) as client:
            about = client.get("/api/workbench/about").json()
            assert about["limits"] == {axis.name: {
                "position_min": axis.limits.position_min, "position_max": axis.limits.position_max,
                "speed": axis.limits.speed, "torque": axis.limits.torque, "fingerprint": axis.fingerprint,
            }}  # fmt: skip
            view = sent(client, short, tmp_path)
            assert view["position"] == pytest.approx([short["position"].min(), short["position"].max()])
            assert view["speed"] == pytest.approx(np.abs(short["velocity"]).max())
            assert view["torque_limit"] == short.metadata.torque_limit
            bare = replace(short, floats={name: v for name, v in short.floats.items() if name != "velocity"})
            assert sent(client, bare, tmp_path)["speed"] is None
    finally:
        engine.close()


def test_the_page_is_whole_and_asks_nobody_else(client: TestClient) -> None:
    page = client.get("/workbench", headers={"Authorization": ""})
    assert page.status_code == 200
    assert "default-src 'none'" in page.headers["content-security-policy"]
    scripts = 0
    for part in SCRIPTS:
        answer = client.get(f"/web/{part}", headers={"Authorization": ""})
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/javascript")
        scripts += len(answer.content)
        assert "http://" not in answer.text.replace("http://www.w3.org", "")
    assert scripts <= 150_000  # bytes, before Plotly


@pytest.mark.parametrize("path", ["../cli/main.py", "vendor/../../theme.py", "%2e%2e/theme.py", "x.js"])
def test_no_other_file_is_given_away(client: TestClient, path: str) -> None:
    assert client.get(f"/web/{path}").status_code in (401, 404)


def test_without_the_token_nothing_is_told(client: TestClient) -> None:
    for path in ("/api/workbench/about", "/api/workbench/recordings"):
        assert client.get(path, headers={"Authorization": ""}).status_code == 401
        assert client.get(path, headers={"Authorization": "Bearer wrong"}).status_code == 403


def test_what_is_gone_is_said(client: TestClient) -> None:
    gone = "0" * 32
    for answer in (
        client.get(f"/api/workbench/recordings/{gone}/trace?columns=torque"),
        client.post("/api/workbench/jobs", json={"kind": "fit", "recordings": [gone]}),
    ):
        assert answer.status_code == 404
        assert "drop the file again" in answer.json()["detail"]
    assert client.get(f"/api/workbench/jobs/{gone}").status_code == 404


def test_wrong_wishes_are_said(client: TestClient) -> None:
    assert client.post("/api/workbench/jobs", json={"kind": "move", "recordings": []}).status_code == 422
    nothing = done(client, kind="fit", recordings=[])
    assert "no recording is chosen" in nothing["error"]
    foreign = client.post("/api/workbench/recordings?name=thing.csv", content=b"a,b\n1,2\n")
    assert foreign.status_code == 422
    assert "column" in foreign.json()["detail"]
    options = json.dumps({"format": "xyz"})
    answer = client.post(
        "/api/workbench/import", params={"name": "a.csv", "options": options}, content=b"a,b\n1,2\n"
    )
    assert answer.status_code == 422
    assert "known are" in answer.json()["detail"]


@pytest.mark.parametrize("options", ["", "[]", "{", '{"format": 1}', '{"period": "x"}', '{"more": 1}'])
def test_options_that_are_none_are_said(client: TestClient, options: str) -> None:
    answer = client.post("/api/workbench/import", params={"name": "a.csv", "options": options}, content=b"1")
    assert answer.status_code == 422
    assert answer.json()["detail"].startswith("options")
    assert "JSON object" in answer.json()["detail"]


def test_every_refusal_is_in_the_description(tmp_path: Path) -> None:
    app = FastAPI()
    app.include_router(workbench_routes(Files(tmp_path), Engine()))
    told = app.openapi()["paths"]["/api/workbench/jobs/{job}"]["get"]["responses"]
    assert {"401", "403", "404", "422"} <= set(told)


def test_a_computation_is_stopped(client: TestClient, tmp_path: Path) -> None:
    view = sent(client, made(100_000), tmp_path)
    job = client.post("/api/workbench/jobs", json={"kind": "fit", "recordings": [view["id"]]}).json()
    stopped = client.post(f"/api/workbench/jobs/{job['id']}/stop").json()
    assert stopped["state"] == "stopped"
    after = done(client, kind="fit", recordings=[])  # the next one begins a new process
    assert "no recording is chosen" in after["error"]


def upload(parts: list[bytes | None], folder: Path, most: int) -> tuple[int, dict[str, Any], list[int]]:
    """Sends a body of unknown length; the answer, and what was on disk at each part. A None: it goes away."""
    files, engine = Files(folder), Engine()
    rules = Rules(TOKEN, True, frozenset({"127.0.0.1"}), 1000, 60.0, most_upload=most)
    app = AccessGuard(make_app(files, engine), rules)
    came: list[Any] = []
    on_disk: list[int] = []
    left = [*parts]

    async def receive() -> dict[str, Any]:
        on_disk.append(sum(path.stat().st_size for path in folder.glob("incoming-*")))
        part = left.pop(0)
        if part is None:
            return {"type": "http.disconnect"}
        return {"type": "http.request", "body": part, "more_body": bool(left)}

    async def send(message: Any) -> None:
        came.append(message)

    head = [(b"host", b"127.0.0.1"), (b"authorization", b"Bearer secret"), (b"transfer-encoding", b"chunked")]
    scope = {
        "type": "http", "method": "POST", "path": "/api/workbench/recordings", "raw_path": b"", "root_path": "",
        "query_string": b"name=a.csv", "headers": head, "scheme": "http", "server": ("127.0.0.1", 80),
    }  # fmt: skip
    asyncio.run(app(scope, receive, send))
    engine.close()
    return came[0]["status"], json.loads(came[1]["body"]), on_disk


def test_a_recording_goes_to_disk_as_it_comes(tmp_path: Path) -> None:
    text = "time,position,torque\n" + "".join(f"{k * 1e-3:.3f},{k * 1e-5:.5f},0.1\n" for k in range(400_000))
    parts: list[bytes | None] = [text[at : at + 500_000].encode() for at in range(0, len(text), 500_000)]
    status, view, on_disk = upload(parts, tmp_path / "held", 20_000_000)
    assert status == 200, view
    assert view["rows"] == 400_000
    assert on_disk[-1] >= 4_000_000  # of 7.6 MB
    assert not list((tmp_path / "held").glob("incoming-*"))


def test_a_body_without_an_end_is_cut_off(tmp_path: Path) -> None:
    status, said, on_disk = upload([b"x" * 1_000_000] * 50, tmp_path / "held", 3_500_000)
    assert status == 413
    assert "larger than 3500000 bytes" in said["detail"]
    assert len(on_disk) == 4
    assert not list((tmp_path / "held").iterdir())


def test_a_page_that_goes_away_leaves_nothing(tmp_path: Path) -> None:
    status, said, _ = upload([b"time,position,torque", None], tmp_path / "held", 1000)
    assert (status, said["detail"]) == (400, "the connection was closed before the file was here")
    assert not list((tmp_path / "held").iterdir())


def test_answers_are_kept_within_a_bound_and_passed_on_as_they_came(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fifty comparisons as lists of numbers took the service 400 MB."""
    monkeypatch.setattr(engine_module, "MOST_ANSWERS", 100)
    engine = Engine()
    jobs = [Job(str(number), {"kind": "compare"}, state="running") for number in range(3)]
    for job in jobs:
        engine._jobs[job.id] = job
        engine._done(job, json.dumps({"rows": "x" * 60}))
    assert list(engine._jobs) == ["2"], "the newest is there, whatever its size"
    told = json.loads(engine.get("2").text())
    assert (told["state"], told["answer"]) == ("done", {"rows": "x" * 60})
    assert json.loads(Job("3", {"kind": "fit"}).text())["answer"] is None
