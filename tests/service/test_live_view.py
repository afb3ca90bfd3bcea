"""Looking on at what a service does: `check --view` where it owns the axis, and `view` at any time."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import pytest

from tests.service.test_live import CLI, PATIENCE, Live, live

__all__ = ["live"]
pytestmark = [pytest.mark.slow, pytest.mark.long]


def test_a_check_of_the_service_is_seen_and_who_comes_later_sees_the_last_minute(live: Live) -> None:
    live.environment = {name: value for name, value in live.environment.items() if "DISPLAY" not in name}
    live.start()
    done = live.call("check", "one.toml", "--view", "--json")
    assert done.returncode == 0, done.stderr
    assert "live view: http://127.0.0.1:" in done.stderr
    assert f"owned by the service at {live.address}" in done.stderr
    log = live.folder / "view.log"
    with (
        log.open("w") as errors,
        subprocess.Popen(
            [*CLI, "view", "one.toml"], cwd=live.folder, stderr=errors, text=True, env=live.environment
        ) as view,
    ):
        live.wait_for(lambda: "attached to axis one" in log.read_text())
        assert view.poll() is None
        live.end(signal.SIGTERM)
        live.wait_for(lambda: "waiting for it" in log.read_text())
        view.send_signal(signal.SIGTERM)
        view.wait(PATIENCE)
    assert view.returncode == 0
    assert "Traceback" not in log.read_text()


@pytest.mark.timeout(900)
def test_a_run_of_the_service_is_seen_and_its_report_names_the_way_to_its_traces(live: Live) -> None:
    live.environment = {name: value for name, value in live.environment.items() if "DISPLAY" not in name}
    live.start()
    done = live.call("run", "one.toml", "--yes", "--view", "--json")
    assert done.returncode == 0, done.stderr
    assert "live view: http://127.0.0.1:" in done.stderr
    assert f"owned by the service at {live.address}" in done.stderr
    found = json.loads(done.stdout)
    assert found["outcome"] == "kept"
    folder = live.folder / "runs" / Path(found["run_directory"]).name
    assert f"autotune view {found['run_directory']}" in (folder / "report.html").read_text()
    assert (folder / "run.rrd").is_file()


def test_what_a_job_did_is_there_for_who_comes_later(live: Live) -> None:
    import http.client
    import socket

    from tests.service.test_live_hub import received

    live.start()
    job = live.submit("check")
    live.wait_for(lambda: live.get(f"/api/jobs/{job}")["state"] == "done")
    connection = http.client.HTTPConnection(
        "127.0.0.1", int(live.address.rpartition(":")[2]), timeout=PATIENCE
    )
    connection.request("GET", "/api/axes/one/live")
    answer = connection.getresponse()
    data = b""
    while not (data and len(received(data)[1]) > 20_000):
        data += answer.read1(1 << 20)
    notes, rows = received(data)
    assert [note["name"] for note in notes if note["kind"] == "stage"] == ["look"]
    assert rows[-1, 0] - rows[0, 0] > 20.0
    if connection.sock is not None:
        connection.sock.shutdown(socket.SHUT_RDWR)
    connection.close()
