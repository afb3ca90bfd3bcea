"""The drive as a process, spoken to by an independent master: the canopen package over python-can's slcan."""

from __future__ import annotations

import errno
import os
import signal
import stat
import struct
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import canopen
import pytest

from autotune_sim.__main__ import main
from autotune_sim.faults import FAULTS
from tests.node.support import EDS, NODE, Simulator

Start = Callable[..., Simulator]
SAVE = 0x65766173


@contextmanager
def master(port: Path) -> Iterator[Any]:
    """A canopen node on the far side of the port."""
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.05
    network.connect(interface="slcan", channel=str(port), bitrate=1_000_000, sleep_after_open=0)
    try:
        node = network.add_node(NODE, str(EDS))
        node.sdo.RESPONSE_TIMEOUT = 5.0
        yield node
    finally:
        network.disconnect()


def configure(node: Any) -> None:
    """Maps what a cycle needs, in both directions."""
    node.tpdo.read()
    node.rpdo.read()
    for number in range(1, 5):
        for pdo in (node.rpdo[number], node.tpdo[number]):
            pdo.enabled = False
    for pdo, variables in (
        (node.rpdo[1], [0x6040, 0x607A]),
        (node.tpdo[1], [0x6041, 0x6064]),
        (node.tpdo[2], [0x60F4, 0x606C]),
    ):
        pdo.clear()
        for variable in variables:
            pdo.add_variable(variable)
        pdo.trans_type = 1
        pdo.enabled = True
    node.rpdo.save()
    node.tpdo.save()
    node.samples = SimpleQueue()
    node.tpdo[1].add_callback(lambda pdo: node.samples.put([variable.raw for variable in pdo]))


def cycle(node: Any, controlword: int, position: int) -> tuple[int, int]:
    """One SYNC; status word and position."""
    pdo = node.rpdo[1]
    pdo["Controlword"].raw = controlword
    pdo["Target position"].raw = position
    pdo.transmit()
    node.network.send_message(0x80, b"")
    word, actual = node.samples.get(timeout=20.0)
    return word, actual


def test_an_independent_master_does_its_job(simulate: Start) -> None:
    simulator = simulate()
    with master(simulator.port) as node:
        assert node.sdo["Manufacturer device name"].raw == "autotune-sim"  # segmented
        assert node.sdo["Identity object"]["Vendor-ID"].raw == 0x7FFFA701  # expedited
        node.sdo["Producer heartbeat time"].raw = 50
        assert node.nmt.wait_for_heartbeat(5.0) == "PRE-OPERATIONAL"
        configure(node)
        node.nmt.state = "OPERATIONAL"
        on_its_way = 1  # a heartbeat may have left before the command came
        told = [node.nmt.wait_for_heartbeat(5.0) for _ in range(on_its_way + 1)]
        assert told[-1] == "OPERATIONAL"
        position = cycle(node, 0, 0)[1]
        for controlword, wanted in ((6, 0x21), (7, 0x23), (15, 0x27)):
            word, position = cycle(node, controlword, position)
            assert word & 0x6F == wanted
        for k in range(100):
            word, actual = cycle(node, 15, position + 10 * k)
            assert word & 0x6F == 0x27
        assert abs(actual - position - 990) < 60
        word, _ = cycle(node, 0, 0)
        assert word & 0x6F == 0x40
    assert simulator.close() == 0
    assert not simulator.port.is_symlink()


def test_recorder_by_block_upload(simulate: Start) -> None:
    simulator = simulate()
    with master(simulator.port) as node:
        node.sdo[0x2400][4].raw = 500
        node.sdo[0x2400][1].raw = 2
        for _ in range(600):
            node.network.send_message(0x80, b"")
        deadline = time.monotonic() + 20
        while node.sdo[0x2400][2].raw != 3:
            assert time.monotonic() < deadline
        with node.sdo[0x2402].open("rb", block_transfer=True) as file:
            data = file.read()
        assert len(data) == 500 * 16
        with node.sdo[0x2402].open("rb") as file:
            assert file.read() == data


def test_emcy_and_aborts_reach_the_master(simulate: Start) -> None:
    simulator = simulate()
    with master(simulator.port) as node:
        simulator.command("drive-fault=2310")
        simulator.expect("-> FAULT")
        assert node.sdo["Error code"].raw == 0x2310
        assert [(emergency.code, emergency.register) for emergency in node.emcy.log] == [(0x2310, 0x03)]
        with pytest.raises(canopen.SdoAbortedError) as aborted:
            node.sdo["Position controller"]["Proportional gain"].raw = -1.0
        assert aborted.value.code == 0x06090032
        node.sdo["Controlword"].raw = 0x80
        assert node.sdo["Statusword"].raw & 0x4F == 0x40


def test_stored_values_outlive_the_process(simulate: Start, tmp_path: Path) -> None:
    state = str(tmp_path / "state.json")
    simulator = simulate("--state", state)
    with master(simulator.port) as node:
        node.sdo[0x2100][7].raw = 31.5
        started = time.monotonic()
        node.sdo[0x1010][1].raw = SAVE
        assert time.monotonic() - started > 0.25
        node.sdo[0x2100][8].raw = 0.5
    simulator.process.kill()  # without a chance to tidy up
    simulator.process.wait()
    assert simulator.port.is_symlink()
    again = simulate("--state", state)
    with master(again.port) as node:
        assert node.sdo[0x2100][7].raw == 31.5
        assert node.sdo[0x2100][8].raw == 0.0


def gone(host: int) -> bool:
    """True where the port does not answer any more, as with a cable that has been pulled out."""
    try:
        return os.read(host, 100) == b""
    except OSError as error:
        return error.errno == errno.EIO


def test_unplugged_adapter(simulate: Start) -> None:
    simulator = simulate()
    host = os.open(simulator.port, os.O_RDWR | os.O_NOCTTY)
    try:
        simulator.command("unplugged")
        simulator.expect("adapter unplugged")
        assert not simulator.port.is_symlink()
        assert gone(host)
    finally:
        os.close(host)
    simulator.command("clear")
    deadline = time.monotonic() + 20
    while not simulator.port.is_symlink():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    with master(simulator.port) as node:
        assert node.sdo[0x1000].raw == 0x20192


DYING_MASTER = textwrap.dedent(
    """
    import os, sys, time, tty
    port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)
    def say(*commands):
        for command in commands:
            os.write(port, command.encode() + b"\\r")
    def frame(cob_id, data):
        say(f"t{cob_id:03X}{len(data)}{data.hex()}")
    say("C", "S8", "O")
    frame(0x605, bytes.fromhex("2316100196007F00"))  # 1016:01: node 127, 150 ms
    frame(0x605, bytes.fromhex("2B85600000000000"))
    frame(0x000, bytes((1, 5)))
    for word in (6, 7, 15):
        frame(0x205, bytes((word, 0)))
    while True:
        frame(0x77F, b"\\x05")
        frame(0x080, b"")
        os.read(port, 65536)
        sys.stdout.write(f"{time.monotonic():.6f}\\n")
        sys.stdout.flush()
        time.sleep(0.01)
    """
)


def test_a_killed_master_is_noticed(simulate: Start) -> None:
    """The 200 ms of the issue: the drive's share of them, from the last heartbeat that was sent.

    Both times are of the same monotonic clock; a loaded machine may delay a process, hence the margin.
    """
    simulator = simulate()
    dying = subprocess.Popen(
        [sys.executable, "-c", DYING_MASTER, str(simulator.port)], stdout=subprocess.PIPE
    )
    assert dying.stdout is not None
    try:
        simulator.expect("OPERATION_ENABLED")
        for _ in range(20):
            dying.stdout.readline()
    finally:
        dying.kill()
    rest = dying.stdout.read().split()
    dying.stdout.close()
    dying.wait()
    last = float(rest[-1]) if rest else time.monotonic()
    begun = float(simulator.expect("quick stop begun").split()[0])
    assert 0.1 < begun - last < 0.4
    simulator.expect("-> FAULT (axis at rest)")


def test_a_stopped_drive_does_not_blame_its_master(simulate: Start) -> None:
    """While the drive's process is held up, heartbeats pile up: all of them count before any is missed."""
    simulator = simulate()
    with master(simulator.port) as node:
        node.sdo[0x1016][1].raw = 127 << 16 | 400
        for pause in (False, True):
            if pause:
                simulator.process.send_signal(signal.SIGSTOP)
            for _ in range(12):
                node.network.send_message(0x77F, b"\x05")
                time.sleep(0.05)
        simulator.process.send_signal(signal.SIGCONT)
        node.network.send_message(0x77F, b"\x05")
        assert node.sdo[0x603F].raw == 0
        node.sdo[0x1016][1].raw = 0
        assert not any("lost" in line for line in simulator.lines)


def test_real_time(simulate: Start) -> None:
    simulator = simulate("--real-time")
    with master(simulator.port) as node:
        before = node.sdo[0x2210][1].raw
        time.sleep(0.3)
        assert node.sdo[0x2210][1].raw - before > 100
        assert node.sdo[0x1002].raw & 8 == 0


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["--preset", "edm-vertcal"], "edm-vertical"),
        (["--effect", "stribek"], "stribeck"),
        (["--effect", "stribeck=much"], "must be a number"),
        (["--fault", "silnt"], "silent"),
        (["--node", "0"], "1 to 127"),
        (["--seed", "-1"], "0 or above"),
    ],
)
def test_mistakes_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], hint: str
) -> None:
    assert main([str(tmp_path / "port"), *arguments]) == 2
    assert hint in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_is_taken(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("mine")
    run = subprocess.run(
        [sys.executable, "-m", "autotune_sim", str(taken)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == 2
    assert "choose another path" in run.stderr
    assert "Traceback" not in run.stderr
    assert taken.read_text() == "mine"


def test_help_names_the_options() -> None:
    run = subprocess.run(
        [sys.executable, "-m", "autotune_sim", "--help"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert "--real-time" in run.stdout
    for name in FAULTS:
        assert name in run.stdout.replace("\n", " ")


def test_the_port_is_a_terminal(simulate: Start) -> None:
    simulator = simulate()
    assert stat.S_ISCHR(os.stat(simulator.port).st_mode)


def test_sdo_by_hand(simulate: Start) -> None:
    """The wire's bytes, without any package between: opening, an upload, its answer."""
    simulator = simulate()
    host = os.open(simulator.port, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(
            host, b"C\rS8\rO\rt6058" + struct.pack("<BHB", 0x40, 0x1000, 0).hex().encode() + b"00000000\r"
        )
        answer = b""
        while b"t585" not in answer or not answer.endswith(b"\r"):
            answer += os.read(host, 1000)
        assert b"z\rt58584300100092010200\r" in answer
    finally:
        os.close(host)
