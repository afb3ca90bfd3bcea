"""The ring buffer: rows arrive once, in order, whole; a full ring drops and says so."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.loop import ROW_FIELDS
from autotune_drivers.cyclic.ring import Ring, create_memory

WIDTH = len(ROW_FIELDS)
MISSED = ROW_FIELDS.index("missed")


def row(number: int) -> tuple[float, ...]:
    values = [float(number)] * WIDTH
    values[MISSED] = 0.0
    return tuple(values)


def sides(capacity: int) -> tuple[Ring, Ring]:
    memory = create_memory(capacity)
    try:
        return Ring(memory), Ring(memory)
    finally:
        os.close(memory)


@pytest.fixture
def pair() -> Iterator[tuple[Ring, Ring]]:
    writer, reader = sides(8)
    yield writer, reader
    writer.close()
    reader.close()


def test_empty_gives_no_rows(pair: tuple[Ring, Ring]) -> None:
    assert pair[1].take().shape == (0, WIDTH)


@given(st.lists(st.one_of(st.integers(1, 8), st.just(0)), max_size=30))
def test_rows_arrive_once_and_in_order(actions: list[int]) -> None:
    """Writes of some rows, each followed by a read; never more than fit."""
    writer, reader = sides(8)
    sent, got = 0, []
    for count in actions:
        for _ in range(count):
            writer.put(row(sent))
            sent += 1
        got += reader.take()[:, 0].tolist()
    writer.close()
    reader.close()
    assert got == [float(number) for number in range(sent)]


def test_a_full_ring_drops_counts_and_says_so_in_the_next_row(pair: tuple[Ring, Ring]) -> None:
    writer, reader = pair
    for number in range(11):
        writer.put(row(number))
    assert reader.dropped == 3
    assert reader.take()[:, 0].tolist() == [float(number) for number in range(8)]
    writer.put(row(11))
    writer.put(row(12))
    rows = reader.take()
    assert rows[:, 0].tolist() == [11.0, 12.0]
    assert rows[:, MISSED].tolist() == [3.0, 0.0]


def test_rows_are_copies(pair: tuple[Ring, Ring]) -> None:
    writer, reader = pair
    writer.put(row(1))
    rows = reader.take()
    for number in range(2, 10):
        writer.put(row(number))
    assert np.all(np.delete(rows, MISSED, axis=1) == 1.0)


def test_interrupt_crosses(pair: tuple[Ring, Ring]) -> None:
    writer, reader = pair
    assert not writer.interrupted
    reader.interrupt()
    assert writer.interrupted
    reader.interrupt(False)
    assert not writer.interrupted


def _write(memory: int, rows: int) -> None:
    ring = Ring(memory)
    for number in range(rows):
        ring.put((float(number), *[0.0] * (len(ROW_FIELDS) - 1)))
    os._exit(0)


def test_a_reader_beside_the_writer_never_sees_a_torn_count() -> None:
    """Counts pass 2**8 and 2**16 often; read byte by byte they would jump ahead or back."""
    rows = 150_000
    memory = create_memory(1 << 18)
    reader = Ring(memory)
    child = os.fork()
    if child == 0:
        _write(memory, rows)
    seen: list[float] = []
    ended = False
    while not ended:
        ended = os.waitpid(child, os.WNOHANG)[0] == child
        seen.extend(reader.take()[:, 0].tolist())
    os.close(memory)
    reader.close()
    assert seen == [float(number) for number in range(rows)]
