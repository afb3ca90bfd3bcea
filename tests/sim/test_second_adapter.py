"""Two adapters on the bus of a simulated drive: what one sends, the drive and the other hear."""

from __future__ import annotations

from pathlib import Path

from autotune_drivers.canopen.frames import drain
from autotune_drivers.canopen.slcan import open_slcan
from tests.drivers.simulator import simulator


def test_frames_reach_the_other_adapter_and_the_drives_answers_both(tmp_path: Path) -> None:
    other = tmp_path / "second.tty"
    with simulator(tmp_path, "--also", str(other)) as drive:
        first, second = open_slcan(drive.port, 1_000_000), open_slcan(other, 1_000_000)
        try:
            heard_other = False
            for _ in range(50):  # the second adapter hears from when its command to open has been read
                first.send((0x123, b"ab"))
                heard_other = (0x123, b"ab") in drain(second, 0.1)
                if heard_other:
                    break
            assert heard_other
            second.send((0x605, bytes((0x40, 0x18, 0x10, 1, 0, 0, 0, 0))))
            heard = drain(first, 0.5), drain(second, 0.1)
        finally:
            first.close()
            second.close()
        answers = [[data for cob_id, data in frames if cob_id == 0x585] for frames in heard]
        assert answers[0]
        assert answers[0] == answers[1]
        assert 0x605 in [cob_id for cob_id, _ in heard[0]]
        assert 0x605 not in [cob_id for cob_id, _ in heard[1]]  # no adapter gives back what it sends
    assert not other.exists()
