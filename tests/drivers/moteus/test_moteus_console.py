"""The console of a moteus behind a line that says things twice."""

from __future__ import annotations

from typing import cast

from autotune_drivers.moteus.console import Console
from autotune_drivers.moteus.node import MoteusNode


class Twice:
    """A controller that gets every command twice, and answers both."""

    number = 1

    def __init__(self, values: dict[str, str]) -> None:
        self.values, self.said = values, b""

    def tell(self, data: bytes) -> int:
        words = data[data.index(b"conf") :].decode().split()
        if words[1] == "set":
            self.values[words[2]] = words[3]
        answer = self.values[words[2]] if words[1] == "get" else "OK"
        self.said += 2 * f"{answer}\r\n".encode()
        return 1


class Heard(Console):
    """What the controller says comes in pieces."""

    def __init__(self, node: Twice) -> None:
        super().__init__(cast("MoteusNode", node))
        self.drive = node

    def _poll(self) -> bytes:
        piece, self.drive.said = self.drive.said[:5], self.drive.said[5:]
        return piece


def test_an_answer_that_comes_twice_is_not_the_next_one() -> None:
    """Regression: the limits of a drive were read one off, and an `OK` of before was no value (seed 1225077)."""
    console = Heard(Twice({"servopos.position_min": "-4", "servopos.position_max": "4"}))
    assert console.get("servopos.position_min") == "-4"
    assert console.get("servopos.position_max") == "4"
    console.set("servopos.position_min", "-3")
    assert console.get("servopos.position_min") == "-3"
    assert console.number("servopos.position_max") == 4.0
