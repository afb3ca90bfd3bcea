"""Where a service owns the axis, the same person is asked as where none does: before it moves, before it is kept."""

from __future__ import annotations

import io
import json
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import typer

from autotune.cli.main import main
from autotune.service.daemon import Owners
from autotune.service.server import HttpServer, listen
from autotune.service.service_file import port_file, token_of
from autotune.service.settings import Watched
from tests.service.conftest import write_axis
from tests.service.test_api import left_run

World = Any
REAL = ("canopen+socketcan://can0?node=5", 'profile = "autotune-sim"', 'profile = "cia402"')


@pytest.fixture
def served(world: Callable[..., World], monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    """A service that has an axis behind a real link, and the working directory beside its file."""
    here = world(["one"], head="[http]\nport = 0\n")
    axis = write_axis(here.folder, "one", REAL[0])
    axis.write_text(axis.read_text().replace(*REAL[1:]))
    here.close()
    here.open()
    owners = Owners()
    owners.ensure(here.configuration, set())
    here.manager.owns = owners.holds
    here.manager.tick()
    http = here.configuration.service.http
    server = HttpServer(here.manager, http, token_of(here.configuration.state), listen(http))
    port_file(here.configuration.state).write_text(f"{server.port}\n")
    server.start()
    monkeypatch.chdir(here.folder)
    monkeypatch.delenv("AUTOTUNE_SERVICE", raising=False)
    yield here
    server.close()
    owners.release()


def exit_code(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    return int(str(ended.value.code))


@contextmanager
def doing_jobs(here: World, **ends: tuple[str, int, str, str]) -> Iterator[None]:
    """Ends every job that begins with (outcome, code, run, asked) of its kind."""
    over = threading.Event()

    def rounds() -> None:
        while not over.wait(0.01):
            here.manager.tick()
            for handle in here.launcher.started:
                if handle.ended is None:
                    outcome, code, run, asked = ends[handle.order.kind]
                    here.finish(outcome, code, run, asked)

    thread = threading.Thread(target=rounds)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@pytest.mark.parametrize("command", ["run", "check"])
def test_nothing_moves_unasked_where_nobody_is_there_to_be_asked(
    served: World, command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert exit_code(command, "one.toml") == 2
    assert "so say --yes" in capsys.readouterr().err
    assert served.store.list_jobs() == []


@pytest.mark.parametrize("command", ["run", "check"])
def test_nothing_moves_where_a_person_says_no(
    served: World, command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    monkeypatch.setattr(typer, "confirm", lambda question, err: False)
    assert exit_code(command, "one.toml") == 2
    assert "nothing has moved" in capsys.readouterr().err
    assert served.store.list_jobs() == []


def test_with_yes_the_service_moves_it_and_keeps_what_is_proved(served: World) -> None:
    run = left_run(served.configuration.runs, "one", "kept", better=True)
    with doing_jobs(served, run=("kept", 0, run, "")):
        assert exit_code("run", "one.toml", "--yes") == 0
    (handle,) = served.launcher.started
    assert handle.order.options["automatic"] is True


@pytest.mark.parametrize(("keep", "code"), [(True, 0), (False, 3)])
def test_who_confirmed_the_motion_is_asked_again_before_anything_is_kept(
    served: World, keep: bool, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[str] = []

    def confirm(question: str, err: bool) -> bool:
        asked.append(question)
        return len(asked) == 1 or keep

    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    monkeypatch.setattr(typer, "confirm", confirm)
    proved = left_run(served.configuration.runs, "one", "not_applied", better=True)
    kept = left_run(served.configuration.runs, "one", "kept", better=True, number=2)
    with doing_jobs(served, run=("not_applied", 3, proved, "Write it?"), commit=("kept", 0, kept, "")):
        assert exit_code("run", "one.toml", "--json") == code
    assert [handle.order.kind for handle in served.launcher.started] == (
        ["run", "commit"] if keep else ["run"]
    )
    assert served.launcher.started[0].order.options["automatic"] is False
    assert len(asked) == 2
    assert "2.00 to 0.50 mrad" in asked[1]
    assert json.loads(capsys.readouterr().out)["outcome"] == ("kept" if keep else "not_applied")


def test_a_run_by_http_or_by_night_is_kept_unasked_only_where_the_file_says_so(
    world: Callable[..., World],
) -> None:
    assert Watched(file="one.toml").commit == "ask"
    for extra, automatic in (("", False), ('commit = "automatic"', True)):
        here = world(extra=extra)
        here.manager.submit("one", "run", "drift")
        here.manager.tick()
        assert here.launcher.started[0].order.options["automatic"] is automatic
        here.finish()


def test_another_program_on_the_link_is_named_and_its_note_is_not_an_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from autotune.service.lock_file import lock_folder
    from autotune.service.ownership import take

    axis = write_axis(tmp_path, "one", REAL[0])
    monkeypatch.chdir(tmp_path)
    held = take("can:can0", "one", "autotune serve")
    (lock,) = lock_folder().iterdir()
    lock.write_text(lock.read_text()[:-1] + ', "address": "http://127.0.0.1:1", "token_file": "/etc/shadow"}')
    assert exit_code("check", str(axis)) == 2
    error = capsys.readouterr().err
    assert "held by autotune serve" in error
    assert "AUTOTUNE_SERVICE=FILE" in error
    assert "shadow" not in error
    held.release()
