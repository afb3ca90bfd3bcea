"""An independent master, the `moteus` package of the controllers' maker, drives our simulated controller."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import pytest

from tests.drivers.simulator import Simulator, simulator

moteus = pytest.importorskip("moteus", reason="the moteus package is not installed")
pytestmark = pytest.mark.slow  # has a process of its own

R = moteus.Register
EXTRA = (
    R.POSITION_KP,
    R.POSITION_KI,
    R.POSITION_KD,
    R.POSITION_FEEDFORWARD,
    R.POSITION_COMMAND,
    R.CONTROL_POSITION,
)

Session = Callable[[Any, Any], Awaitable[Any]]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("peer"), "--link", "moteus", "--node", "1") as process:
        yield process


def with_peer(process: Simulator, session: Session, **options: Any) -> Any:
    """Runs `session(controller, stream)` and stops the controller afterwards."""

    async def run() -> Any:
        transport = moteus.Fdcanusb(str(process.port))
        resolution = moteus.QueryResolution()
        resolution._extra = dict.fromkeys(EXTRA, moteus.multiplex.F32)
        controller = moteus.Controller(id=1, transport=transport, query_resolution=resolution, **options)
        try:
            await controller.set_stop()
            stream = moteus.Stream(controller)
            await stream.flush_read(0.05)
            return await session(controller, stream)
        finally:
            await controller.set_stop()
            transport.close()

    return asyncio.run(run())


def test_a_query_tells_a_controller_at_rest(running: Simulator) -> None:
    async def session(controller: Any, _: Any) -> Any:
        return (await controller.query()).values

    values = with_peer(running, session)
    assert values[R.MODE] == moteus.Mode.STOPPED
    assert values[R.FAULT] == 0
    assert values[R.VOLTAGE] == 24.0
    assert abs(values[R.VELOCITY]) < 0.01
    assert math.isnan(values[R.CONTROL_POSITION])


def test_position_commands_are_followed_and_the_torques_add_up(running: Simulator) -> None:
    async def session(controller: Any, _: Any) -> list[Any]:
        start = (await controller.query()).values[R.POSITION]
        seen = []
        for k in range(400):
            target = start + 0.03 * math.sin(2.0 * math.pi * k / 1000)
            result = await controller.set_position(
                position=target, velocity=0.0, feedforward_torque=0.05, watchdog_timeout=1.0, query=True
            )
            seen.append((target, result.values))
        return seen

    for target, values in with_peer(running, session)[50:]:
        assert values[R.MODE] == moteus.Mode.POSITION
        assert values[R.CONTROL_POSITION] == pytest.approx(target, abs=1.1e-5)  # half a count, in float
        assert values[R.POSITION] == pytest.approx(target, abs=1e-3)
        assert values[R.POSITION_FEEDFORWARD] == pytest.approx(0.05)
        parts = values[R.POSITION_KP] + values[R.POSITION_KI] + values[R.POSITION_KD]
        # as in the firmware: computed from measured - desired, and pid_position.sign is -1
        assert values[R.POSITION_COMMAND] == pytest.approx(0.05 - parts, abs=1e-6)


@pytest.mark.parametrize("resolution", ["INT8", "INT16", "INT32", "F32"])
def test_every_resolution_says_the_same(running: Simulator, resolution: str) -> None:
    form = getattr(moteus.multiplex, resolution)
    steps = {"INT8": 0.01, "INT16": 1e-4, "INT32": 1e-5, "F32": 1e-6}

    async def session(controller: Any, _: Any) -> tuple[float, float]:
        exact = (await controller.query()).values[R.POSITION]
        found = await controller.custom_query({R.POSITION: form})
        return exact, found.values[R.POSITION]

    exact, found = with_peer(running, session)
    # an axis that settles behind its brake may go on by a count or two of 2e-5
    assert found == pytest.approx(exact, abs=steps[resolution] + 5e-5)


def test_the_watchdog_stops_the_axis_and_latches(running: Simulator) -> None:
    mark = running.mark

    async def session(controller: Any, _: Any) -> tuple[Any, Any, Any]:
        for _ in range(300):
            await controller.set_position(position=math.nan, velocity=0.5, watchdog_timeout=0.1)
        await asyncio.sleep(0.5)
        late = await controller.query()
        again = await controller.set_position(position=math.nan, velocity=0.5, query=True)
        await controller.set_stop()
        fresh = await controller.set_position(position=math.nan, query=True)
        return late.values, again.values, fresh.values

    late, again, fresh = with_peer(running, session)
    running.wait_for("quick stop begun (watchdog", mark)
    assert late[R.MODE] == again[R.MODE] == moteus.Mode.TIMEOUT
    assert abs(late[R.VELOCITY]) < 0.01
    assert fresh[R.MODE] == moteus.Mode.POSITION


def test_velocity_commands_move_the_demand(running: Simulator) -> None:
    async def session(controller: Any, _: Any) -> list[float]:
        speeds = []
        for _ in range(700):
            result = await controller.set_position(
                position=math.nan, velocity=0.4, watchdog_timeout=1.0, query=True
            )
            speeds.append(result.values[R.VELOCITY])
        return speeds

    speeds = with_peer(running, session)
    assert sum(speeds[-300:]) / 300 == pytest.approx(0.4, abs=0.02)


def test_torque_is_commanded_without_feedback(running: Simulator) -> None:
    async def session(controller: Any, _: Any) -> Any:
        for _ in range(50):
            result = await controller.set_position(
                position=math.nan,
                feedforward_torque=0.06,
                kp_scale=0.0,
                kd_scale=0.0,
                ilimit_scale=0.0,
                watchdog_timeout=1.0,
                query=True,
            )
        return result.values

    values = with_peer(running, session)
    assert values[R.POSITION_COMMAND] == pytest.approx(0.06, abs=1e-6)
    assert values[R.POSITION_KP] == values[R.POSITION_KI] == values[R.POSITION_KD] == 0.0


def test_trajectory_limits_bring_the_axis_there(running: Simulator) -> None:
    async def session(controller: Any, _: Any) -> tuple[float, float, float, Any]:
        start = (await controller.query()).values[R.POSITION]
        fastest, previous = 0.0, start
        for _ in range(2000):
            result = await controller.set_position(
                position=start + 0.3, velocity_limit=0.5, accel_limit=4.0, watchdog_timeout=1.0, query=True
            )
            fastest = max(fastest, abs(result.values[R.CONTROL_POSITION] - previous) / 1e-3)
            previous = result.values[R.CONTROL_POSITION]
        complete = await controller.custom_query({R.TRAJECTORY_COMPLETE: moteus.multiplex.INT8})
        return start, result.values[R.POSITION], fastest, complete.values

    start, end, fastest, complete = with_peer(running, session)
    assert end == pytest.approx(start + 0.3, abs=1e-3)
    assert fastest == pytest.approx(0.5, abs=0.03)  # one count a millisecond is 0.02
    assert complete[R.TRAJECTORY_COMPLETE] == 1


def test_the_console_reads_sets_and_stores(running: Simulator) -> None:
    async def session(_: Any, stream: Any) -> tuple[bytes, bytes, bytes, bytes, list[bytes]]:
        before = await stream.command(b"conf get servo.pid_position.kp", allow_any_response=True)
        await stream.command(b"conf set servo.pid_position.kp 300.5")
        after = await stream.command(b"conf get servo.pid_position.kp", allow_any_response=True)
        await stream.command(b"conf write")
        await stream.command(b"conf set servo.pid_position.kp 200")
        await stream.command(b"conf load")
        loaded = await stream.command(b"conf get servo.pid_position.kp", allow_any_response=True)
        await stream.command(b"conf default")
        default = await stream.command(b"conf get servo.pid_position.kp", allow_any_response=True)
        await stream.command(b"conf write")
        listing = (await stream.command(b"conf enumerate")).split(b"\n")
        return before, after, loaded, default, listing

    before, after, loaded, default, listing = with_peer(running, session)
    assert before == default == b"376.991"
    assert after == loaded == b"300.5"
    assert b"id.id 1" in listing
    assert b"servo.timeout_mode 12" in listing
    assert len(listing) > 30


@pytest.mark.parametrize(
    "command", ["conf set servo.nix 1", "conf get nix.nix", "conf set servo.max_velocity fast", "nix", "conf"]
)
def test_the_console_refuses_what_it_does_not_know(running: Simulator, command: str) -> None:
    async def session(_: Any, stream: Any) -> None:
        await stream.command(command.encode())

    with pytest.raises(moteus.CommandError, match="ERR"):
        with_peer(running, session)


def test_registers_that_are_not_there_are_refused_and_others_answered(running: Simulator) -> None:
    async def session(controller: Any, _: Any) -> tuple[Any, Any]:
        model = await controller.custom_query({R.MODEL_NUMBER: moteus.multiplex.INT32})
        unknown = await controller.custom_query({0x7FF: moteus.multiplex.INT8})
        return model.values, unknown.values

    model, unknown = with_peer(running, session)
    assert model == {R.MODEL_NUMBER: 0x7A01}
    assert unknown == {}


def test_zero_velocity_and_brake_take_the_axis_to_rest(running: Simulator) -> None:
    async def session(controller: Any, _: Any) -> list[Any]:
        seen = []
        for end in (controller.set_zero_velocity, controller.set_brake):
            for _ in range(200):
                await controller.set_position(position=math.nan, velocity=0.3, watchdog_timeout=1.0)
            await end()
            await asyncio.sleep(0.3)
            seen.append((await controller.query()).values)
            await controller.set_stop()
        return seen

    for values in with_peer(running, session):
        assert abs(values[R.VELOCITY]) < 0.01
