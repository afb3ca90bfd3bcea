"""The command line's client against a real server: the token on every request, truth about a job that is lost."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from autotune.core.errors import ConfigurationError, Interrupted, LinkError
from autotune.service import client as client_module
from autotune.service.client import NoService, ServiceClient
from autotune.service.server import HttpServer, listen
from autotune.service.service_file import address_of, known_token, port_file, service_file, token_of
from autotune.service.settings import Http, read_service
from tests.service.conftest import write_axis, write_service

World = Any
EVERYWHERE = '[http]\nhost = "0.0.0.0"\nport = 0\n'


@dataclass
class Told:
    """A reporter that remembers, and lets the test act when something is reported."""

    said: list[str] = field(default_factory=list)
    act: Callable[[], None] = lambda: None

    def stage(self, name: str, seconds: float) -> None:
        self.said.append(name)

    def progress(self, fraction: float) -> None:
        self.act()

    def say(self, sentence: str) -> None:
        self.said.append(sentence)


@pytest.fixture
def served(world: Callable[..., World], request: pytest.FixtureRequest) -> Iterator[tuple[World, HttpServer]]:
    """A service whose reading needs the token as well, as where other machines reach it."""
    here = world(["one"], head=getattr(request, "param", EVERYWHERE))
    here.manager.tick()
    http = here.configuration.service.http
    here.configuration.state.mkdir(parents=True, exist_ok=True)
    server = HttpServer(here.manager, http, token_of(here.configuration.state), listen(http))
    port_file(here.configuration.state).write_text(f"{server.port}\n")
    server.start()
    yield here, server
    server.close()


def client_of(here: World, patience: float = 0.0) -> ServiceClient:
    return ServiceClient(here.configuration, poll=0.01, patience=patience)


def test_a_job_is_started_and_followed_with_the_token_where_reading_needs_it(
    served: tuple[World, HttpServer],
) -> None:
    here, server = served
    assert address_of(here.configuration) == f"http://127.0.0.1:{server.port}"
    client = client_of(here)
    assert client.holds("one")
    job = client.start("one", "check")
    here.manager.tick()

    def end() -> None:
        here.finish("done", 0)

    assert client.follow(job, Told(act=end))["state"] == "done"


def test_ctrl_c_stops_the_job_and_says_how_it_ended(served: tuple[World, HttpServer]) -> None:
    here, _ = served
    client = client_of(here)
    job = client.start("one", "check")
    here.manager.tick()
    handle = here.launcher.started[0]

    def interrupt() -> None:
        raise KeyboardInterrupt

    def watch() -> None:
        while not handle.stopped:
            pass
        here.finish("aborted", 130)

    threading.Thread(target=watch, daemon=True).start()
    with pytest.raises(Interrupted, match=r"stopped at the service: It ended\."):
        client.follow(job, Told(act=interrupt))
    assert handle.stopped


def test_a_job_that_does_not_end_when_stopped_is_not_called_stopped(
    served: tuple[World, HttpServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, server = served
    monkeypatch.setattr(client_module, "STOP_SECONDS", 0.05)
    client = client_of(here)
    job = client.start("one", "check")
    here.manager.tick()

    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(Interrupted, match=r"COULD NOT BE STOPPED: it has not ended"):
        client.follow(job, Told(act=interrupt))

    def interrupt_and_vanish() -> None:
        server.close()
        raise KeyboardInterrupt

    with pytest.raises(Interrupted, match=rf"job {job['id']}\) COULD NOT BE STOPPED.*MAY STILL MOVE"):
        client.follow(job, Told(act=interrupt_and_vanish))


def test_a_service_that_falls_silent_is_a_link_error_that_names_the_job_and_its_state(
    served: tuple[World, HttpServer],
) -> None:
    here, server = served
    client = client_of(here)
    job = client.start("one", "check")
    here.manager.tick()
    here.launcher.started[0].told.append({"event": "stage", "stage": "look"})
    here.manager.tick()
    with pytest.raises(
        LinkError, match=rf"job {job['id']}\) was running, stage look.*THE AXIS MAY MOVE"
    ) as lost:
        client.follow(job, Told(act=server.close))
    assert lost.value.exit_code == 5


def test_a_silence_that_ends_in_time_costs_nothing(
    served: tuple[World, HttpServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, _ = served
    client = client_of(here, patience=60.0)
    job = client.start("one", "check")
    here.manager.tick()
    answers = client._exchange
    fails = iter([True, True, False])

    def sometimes(*arguments: Any) -> Any:
        if next(fails, False):
            raise TimeoutError("timed out")
        return answers(*arguments)

    here.finish("done", 0)
    monkeypatch.setattr(client, "_exchange", sometimes)
    assert client.follow(job, Told())["outcome"] == "done"


def test_without_the_token_nothing_is_started_and_the_way_to_it_is_named(
    served: tuple[World, HttpServer], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    here, _ = served
    (here.configuration.state / "token").unlink()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "nowhere"))
    with pytest.raises(ConfigurationError, match=r"AUTOTUNE_TOKEN, or write it to .*nowhere/autotune/token"):
        client_of(here).start("one", "check")
    assert here.store.list_jobs() == []


class Thief:
    """Somebody who listens where the service should be and notes what he is sent."""

    def __enter__(self) -> Thief:
        heard = self.heard = []  # type: ignore[var-annotated]

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                heard.append(str(self.headers))
                body = json.dumps({"proof": "0" * 64, "held": True, "detail": "\x1b[2Jgone"}).encode()
                self.send_response(200)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            do_POST = do_GET

            def log_message(self, format: str, *arguments: Any) -> None:
                return

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.port = self._server.server_port
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *whatever: object) -> None:
        self._server.shutdown()
        self._server.server_close()


def configured(folder: Path, port: int) -> Any:
    write_axis(folder, "one")
    return read_service(write_service(folder, ["one"], head=f"[http]\nport = {port}"), planned=False)


def test_who_listens_in_the_services_place_is_not_sent_the_token(tmp_path: Path) -> None:
    with Thief() as thief:
        configuration = configured(tmp_path, thief.port)
        token = token_of(configuration.state)
        with pytest.raises(ConfigurationError, match=r"does not know the token .* nothing was sent"):
            ServiceClient(configuration).start("one", "check")
        assert thief.heard
        assert not any(token in headers for headers in thief.heard)


def test_the_proof_of_a_service_elsewhere_is_not_good_here(
    served: tuple[World, HttpServer], tmp_path: Path
) -> None:
    """A thief who passes the question on to the true service gets a proof for another port."""
    here, server = served
    from autotune.service.access import proof_of

    token = token_of(here.configuration.state)
    assert proof_of(token, server.port, "ab" * 16) != proof_of(token, server.port + 1, "ab" * 16)


def test_nobody_there_is_said_and_a_proxy_is_not_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Thief() as thief:
        monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{thief.port}")
        silent = listen(Http(port=0))
        port = silent.getsockname()[1]
        silent.close()
        with pytest.raises(NoService, match="no service listens"):
            ServiceClient(configured(tmp_path, port)).history("one")
        assert not thief.heard


@pytest.mark.parametrize(
    "content", ["", "short", "a secret of another kind, with spaces\n", "x" * 300, "\x1b[2J" * 9]
)
def test_what_is_no_token_is_never_taken_for_one(
    tmp_path: Path, content: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    configuration = configured(tmp_path, 1)
    configuration.state.mkdir(parents=True)
    (configuration.state / "token").write_text(content)
    with pytest.raises(ConfigurationError, match="does not hold a token"):
        known_token(configuration)
    monkeypatch.setenv("AUTOTUNE_TOKEN", content or "ü" * 20)
    with pytest.raises(ConfigurationError, match="AUTOTUNE_TOKEN does not hold a token"):
        known_token(configuration)


def test_a_token_behind_a_link_is_not_read(tmp_path: Path) -> None:
    configuration = configured(tmp_path, 1)
    configuration.state.mkdir(parents=True)
    (tmp_path / "precious").write_text("a" * 40)
    (configuration.state / "token").symlink_to(tmp_path / "precious")
    assert known_token(configuration) == ""
    with pytest.raises(ConfigurationError, match="cannot be used"):
        token_of(configuration.state)


def test_an_empty_token_file_gets_a_new_token_and_one_that_others_could_read_is_refused(
    tmp_path: Path,
) -> None:
    path = tmp_path / "token"
    path.write_text("")
    path.chmod(0o600)
    token = token_of(tmp_path)
    assert len(token) >= 32
    assert path.read_text().strip() == token
    assert path.stat().st_mode & 0o777 == 0o600
    assert token_of(tmp_path) == token
    for mode, word in ((0o644, "could read"), (0o620, "could have written")):
        path.chmod(mode)
        with pytest.raises(ConfigurationError, match=word):
            token_of(tmp_path)


def test_one_rule_finds_the_service_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("AUTOTUNE_SERVICE", raising=False)
    monkeypatch.setattr("autotune.service.service_file.INSTALLED", tmp_path / "etc.toml")
    assert service_file().name == "service.toml"
    assert tmp_path not in service_file().absolute().parents
    (tmp_path / "etc.toml").touch()
    assert service_file() == tmp_path / "etc.toml"
    (tmp_path / "config").mkdir()
    for path in (Path("config", "service.toml"), Path("service.toml")):
        path.touch()
        assert service_file() == path
    monkeypatch.setenv("AUTOTUNE_SERVICE", "chosen.toml")
    assert service_file() == Path("chosen.toml")
    assert service_file(Path("named.toml")) == Path("named.toml")


@pytest.mark.parametrize("mode", [0o666, 0o777])
def test_a_service_file_that_all_can_write_is_not_used_unnamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("AUTOTUNE_SERVICE", raising=False)
    file = tmp_path / "service.toml"
    file.touch()
    (file if mode == 0o666 else tmp_path).chmod(mode)
    with pytest.raises(ConfigurationError, match="everybody can write"):
        service_file()
    assert service_file(file) == file
