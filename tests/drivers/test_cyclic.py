"""The cyclic process: results, errors, rows, interruptions and deaths."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from multiprocessing import Pipe
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError, ConfigurationError, Interrupted, LinkError
from autotune.core.loop import ROW_FIELDS
from autotune_drivers import open_loop
from autotune_drivers.cyclic.loop import CyclicLoop, Silence
from autotune_drivers.cyclic.messages import STEPS_WITHIN
from autotune_drivers.cyclic.ring import create_memory
from tests.drivers import bus
from tests.drivers.fake_drive import SILENT, FakeOpener
from tests.drivers.routines import Calls, Endless, Sine, Warmed, kill_self, odd, unpicklable, wrong
from tests.drivers.simulator import Simulator, axis_of, simulator

POSITION = ROW_FIELDS.index("position")


@pytest.fixture
def opener(tmp_path: Path) -> FakeOpener:
    return FakeOpener(tmp_path, pause=1e-3)


@pytest.fixture
def loop(opener: FakeOpener) -> Iterator[CyclicLoop]:
    opened = CyclicLoop.open(opener)
    yield opened
    opened.close()


def wait_for(condition: object, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.005)


def test_tells_about_the_drive(loop: CyclicLoop) -> None:
    assert loop.period == 1e-3
    assert loop.identity == {"vendor": 1, "product": 2}
    assert "priority" in loop.priority
    assert loop.faults() == []


def test_plays_returns_and_passes_every_row_once(loop: CyclicLoop) -> None:
    blocks: list[Floats] = []
    assert loop.play(Sine(500), blocks.append) == 501.0
    rows = np.concatenate(blocks)
    assert rows.shape == (500, len(ROW_FIELDS))
    assert np.all(np.diff(rows[:, POSITION]) == 1.0)
    assert len(blocks) > 3  # while it runs, not at its end
    assert loop.dropped == 0


def test_parameters_live_in_the_process(loop: CyclicLoop, opener: FakeOpener) -> None:
    loop.write_parameters({"controller.kp": 50.0})
    assert loop.read_parameters(["controller.kp"]) == {"controller.kp": 50.0}
    loop.store()
    assert "stored" in opener.log


def test_prepare_is_called_before_the_routine(loop: CyclicLoop) -> None:
    assert loop.play(Warmed()) is True


def test_a_routines_error_arrives_with_its_origin(loop: CyclicLoop) -> None:
    with pytest.raises(ZeroDivisionError) as caught:
        loop.play(Calls(wrong))
    assert any("routines.py" in note for note in caught.value.__notes__)
    assert loop.play(Sine(3)) > 0  # and the loop goes on


def test_an_error_that_cannot_travel_becomes_words(loop: CyclicLoop) -> None:
    with pytest.raises(LinkError, match="Odd: odd 1 2"):
        loop.play(Calls(odd))


def test_a_result_that_cannot_travel_is_said(loop: CyclicLoop) -> None:
    with pytest.raises(ConfigurationError, match="cannot travel"):
        loop.play(Calls(unpicklable))


def test_a_routine_that_cannot_travel_is_said(loop: CyclicLoop) -> None:
    with pytest.raises(ConfigurationError, match="class of a module"):
        loop.play(Calls(lambda drive, publish: None))
    assert loop.faults() == []


def test_an_error_of_the_opener_arrives(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="nobody there"):
        CyclicLoop.open(FakeOpener(tmp_path, error="nobody there"))


def test_a_watcher_that_fails_ends_the_routine(loop: CyclicLoop, tmp_path: Path) -> None:
    def fails(rows: Floats) -> None:
        raise RuntimeError("viewer gone")

    with pytest.raises(RuntimeError, match="viewer gone"):
        loop.play(Endless(tmp_path / "witness"), fails)
    assert (tmp_path / "witness").read_text() == "at rest"


@pytest.mark.usefixtures("signals_are_heard")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_brings_the_axis_to_rest_and_all_rows_out(
    loop: CyclicLoop, opener: FakeOpener, tmp_path: Path, number: signal.Signals
) -> None:
    before = signal.getsignal(number)
    blocks: list[Floats] = []
    threading.Timer(0.2, os.kill, (os.getpid(), number)).start()
    with pytest.raises(Interrupted) as caught:
        loop.play(Endless(tmp_path / "witness"), blocks.append)
    assert caught.value.exit_code == 130
    assert (tmp_path / "witness").read_text() == "at rest"
    assert opener.log[-1] == "off"
    repeat = np.concatenate(blocks)[:, -1]
    assert repeat.tolist() == list(range(len(repeat)))
    assert signal.getsignal(number) is before
    assert loop.play(Sine(3)) > 0


def test_another_thread_may_play_and_be_interrupted(loop: CyclicLoop, tmp_path: Path) -> None:
    caught: list[BaseException] = []

    def play() -> None:
        try:
            loop.play(Endless(tmp_path / "witness"))
        except Interrupted as error:
            caught.append(error)

    thread = threading.Thread(target=play)
    thread.start()
    wait_for((tmp_path / "witness").exists)
    loop.interrupt()
    thread.join(20)
    assert len(caught) == 1


def test_close_restores_and_is_idempotent(opener: FakeOpener) -> None:
    loop = CyclicLoop.open(opener)
    loop.close()
    loop.close()
    assert opener.log == ["opened", "closed"]
    with pytest.raises(LinkError, match="closed"):
        loop.faults()


def test_a_process_that_dies_is_said_and_the_next_one_inherits(loop: CyclicLoop, opener: FakeOpener) -> None:
    with pytest.raises(LinkError, match=r"died \(signal 9\).*heartbeat guard"):
        loop.play(Calls(kill_self))
    assert loop.process_id is None
    assert loop.read_parameters() == {"controller.kp": 60.0}
    assert "inherited" in opener.log


def test_closing_after_a_death_restores(opener: FakeOpener) -> None:
    loop = CyclicLoop.open(opener)
    with pytest.raises(LinkError):
        loop.play(Calls(kill_self))
    loop.close()
    assert opener.log[-2:] == ["inherited", "closed"]


def test_a_drive_that_does_not_answer_the_next_process_is_restored_by_the_one_after(
    opener: FakeOpener, tmp_path: Path
) -> None:
    """The failed opening told of no backup, and its owner had nothing to put back any more."""
    loop = CyclicLoop.open(opener)
    with pytest.raises(LinkError, match="died"):
        loop.play(Calls(kill_self))
    (tmp_path / SILENT).touch()
    with pytest.raises(LinkError, match="nobody answers"):
        loop.read_parameters()
    (tmp_path / SILENT).unlink()
    loop.close()
    assert opener.log[-2:] == ["inherited", "closed"]


def test_a_routine_that_is_not_there_does_not_make_the_owner_forget_what_to_restore(
    opener: FakeOpener, monkeypatch: pytest.MonkeyPatch
) -> None:
    here_only = ModuleType("here_only")
    monkeypatch.setitem(sys.modules, "here_only", here_only)
    monkeypatch.setattr(Sine, "__module__", "here_only")
    monkeypatch.setattr(here_only, "Sine", Sine, raising=False)
    loop = CyclicLoop.open(opener)
    with pytest.raises(ConfigurationError, match="importable module"):
        loop.play(Sine(3))
    assert loop.process_id is not None
    os.kill(loop.process_id, signal.SIGKILL)
    with pytest.raises(LinkError, match=r"died \(signal 9\)"):
        loop.faults()
    loop.close()
    assert opener.log[-2:] == ["inherited", "closed"]


def test_a_terminated_process_rests_and_closes(opener: FakeOpener, tmp_path: Path) -> None:
    loop = CyclicLoop.open(opener)
    pid = loop.process_id
    assert pid is not None
    threading.Timer(0.2, os.kill, (pid, signal.SIGTERM)).start()
    with pytest.raises(Interrupted, match="terminated"):
        loop.play(Endless(tmp_path / "witness"))
    wait_for(lambda: opener.log[-1] == "closed")
    assert (tmp_path / "witness").read_text() == "at rest"
    with pytest.raises(LinkError, match="was terminated"):
        loop.faults()
    loop.close()
    assert opener.log[-1] == "closed"


def test_the_last_word_of_a_terminated_process_is_no_answer(tmp_path: Path) -> None:
    """A write that arrives while the process closes its drive was not done, and must not look done."""
    loop = CyclicLoop.open(FakeOpener(tmp_path, pause=1e-3, closing=0.5))
    pid = loop.process_id
    assert pid is not None
    threading.Timer(0.2, os.kill, (pid, signal.SIGTERM)).start()
    with pytest.raises(Interrupted, match="terminated"):
        loop.play(Endless(tmp_path / "witness"))
    with pytest.raises(LinkError, match="was terminated before it could do this"):
        loop.write_parameters({"controller.kp": 50.0})
    assert loop.read_parameters() == {"controller.kp": 60.0}  # of a new process
    loop.close()
    assert FakeOpener(tmp_path).log == ["opened", "on", "off", "closed", "opened", "closed"]


def test_closing_meets_a_process_that_has_closed_by_itself(opener: FakeOpener) -> None:
    loop = CyclicLoop.open(opener)
    assert loop.process_id is not None
    os.kill(loop.process_id, signal.SIGTERM)
    wait_for(lambda: opener.log[-1] == "closed")
    loop.close()
    assert opener.log == ["opened", "closed"]


def test_a_process_whose_owner_died_before_it_began_leaves_the_drive_alone(opener: FakeOpener) -> None:
    """What the owner asked for is still in the pipe: opening would change the drive for nobody."""
    ours, theirs = Pipe()
    memory = create_memory()
    ours.send((opener, None))
    nobody = str(os.getpid() + 1)  # the process sees us as its parent, so this owner is gone
    done = subprocess.run(
        [sys.executable, "-m", "autotune_drivers.cyclic.child", str(theirs.fileno()), str(memory), nobody],
        pass_fds=(theirs.fileno(), memory),
        check=False,
    )
    os.close(memory)
    assert done.returncode == 0
    assert not list(opener.directory.iterdir())  # nor a log


# A process that stalls


def stop_when_moving(loop: CyclicLoop, witness: Path) -> threading.Thread:
    """SIGSTOP of the cyclic process while it plays."""

    def stop() -> None:
        wait_for(witness.exists)
        assert loop.process_id is not None
        os.kill(loop.process_id, signal.SIGSTOP)

    thread = threading.Thread(target=stop)
    thread.start()
    return thread


@pytest.mark.slow
def test_a_stopped_process_is_given_up_and_the_next_one_inherits(
    loop: CyclicLoop, opener: FakeOpener, tmp_path: Path
) -> None:
    pid = loop.process_id
    blocks: list[Floats] = []
    stopper = stop_when_moving(loop, tmp_path / "witness")
    with pytest.raises(LinkError, match=rf"no progress for {STEPS_WITHIN:g} s .*heartbeat guard"):
        loop.play(Endless(tmp_path / "witness"), blocks.append)
    stopper.join()
    assert pid is not None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert len(np.concatenate(blocks)) >= 50  # the rows until then have come
    assert loop.power is None
    assert loop.read_parameters() == {"controller.kp": 60.0}
    assert "inherited" in opener.log


@pytest.mark.slow
def test_a_call_to_a_stopped_process_is_given_up(loop: CyclicLoop) -> None:
    assert loop.process_id is not None
    os.kill(loop.process_id, signal.SIGSTOP)
    with pytest.raises(LinkError, match=f"no progress for {STEPS_WITHIN:g} s"):
        loop.read_parameters()
    assert loop.read_parameters() == {"controller.kp": 60.0}


def test_our_own_pause_is_not_the_other_sides_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("autotune_drivers.cyclic.loop.time.monotonic", lambda: clock[0])
    silence = Silence()
    assert silence.after(7) == 0.0
    clock[0] = 1000.0  # the host was suspended, or we were stopped
    assert silence.after(7) < STEPS_WITHIN
    clock[0] += 0.1
    assert silence.after(8) == 0.0
    for _ in range(60):
        clock[0] += 0.1
        silent = silence.after(8)
    assert silent == pytest.approx(6.0)


# What is said of power


@pytest.mark.parametrize(
    ("power", "words"),
    [(False, "without power, as the drive confirms"), (True, "NOT confirmed"), (None, "NOT confirmed")],
)
def test_an_interruption_says_of_power_what_the_drive_has_told(
    tmp_path: Path, power: bool | None, words: str
) -> None:
    loop = CyclicLoop.open(FakeOpener(tmp_path, pause=1e-3, power=power))
    threading.Timer(0.2, loop.interrupt).start()
    with pytest.raises(Interrupted, match=words):
        loop.play(Endless(tmp_path / "witness"))
    assert loop.power is power
    loop.close()


# Deaths on the wire


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Simulator]:
    with simulator(tmp_path) as process:
        yield process


def test_killed_owner(running: Simulator) -> None:
    """kill -9 of the tuning process: its cyclic process brings the axis to rest and restores."""
    before = bus.settings(running.port)
    witness = running.directory / "witness"
    owner = subprocess.Popen(
        [sys.executable, "-m", "tests.drivers.owner", str(running.directory)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        stdout=subprocess.PIPE,
    )
    with owner:
        wait_for(lambda: witness.exists() and witness.read_text() == "moving")
        mark, killed = running.mark, time.monotonic()
        owner.kill()
        line = running.wait_for("quick stop begun (controlword)", mark)
    running.wait_for("at rest", mark)
    # 200 ms are asked for, 5 ms are usual; the bound leaves a loaded host its time
    assert 0.0 < float(line.split()[0]) - killed < 1.0
    running.wait_for("PRE_OPERATIONAL", mark)
    wait_for(lambda: witness.read_text() == "at rest")
    wait_for(lambda: _free(running.port))
    assert bus.settings(running.port) == before


def test_killed_cyclic_process(running: Simulator) -> None:
    """kill -9 of the cyclic process: the drive's own heartbeat consumer stops the axis."""
    before = bus.settings(running.port)
    witness = running.directory / "witness"
    loop = open_loop(axis_of(), running.directory)
    assert isinstance(loop, CyclicLoop)
    killed: list[float] = []

    def kill() -> None:
        wait_for(witness.exists)
        pid = loop.process_id
        assert pid is not None
        killed.append(time.monotonic())
        os.kill(pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    with pytest.raises(LinkError, match="signal 9"):
        loop.play(Endless(witness))
    killer.join()
    line = running.wait_for("quick stop begun (heartbeat")
    # the drive was told 150 ms; the bound leaves a loaded host its time
    assert 0.0 < float(line.split()[0]) - killed[0] < 1.0
    running.wait_for("at rest")
    loop.close()
    assert bus.settings(running.port) == before


def test_a_loop_that_hangs_with_power_on_is_stopped_by_the_drive(running: Simulator) -> None:
    from tests.drivers.routines import hang

    loop = open_loop(axis_of(), running.directory)
    with pytest.raises(AutotuneError):
        loop.play(Calls(hang))
    running.wait_for("quick stop begun (heartbeat")
    loop.close()


def _free(port: Path) -> bool:
    try:
        with bus.sdo(port) as client:
            client.read(bus.STATUS)
    except LinkError:
        return False
    return True
