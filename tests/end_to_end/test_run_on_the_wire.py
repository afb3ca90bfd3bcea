"""The main job over a real adapter protocol, with the figures that the thesis gives."""

from __future__ import annotations

import json
import shutil

import pytest

from autotune.recordings.files import read_recording
from tests.end_to_end.support import Bench, read_drive
from tests.support.commands import called


@pytest.mark.slow(60)
def test_a_run_on_the_wire_is_kept_leaves_everything_and_can_be_rolled_back(bench: Bench) -> None:
    """A busy host that is late for a tenth of a second and more is stopped by the drive, and begins again."""
    for _ in range(3):
        bench.start()
        present = read_drive(bench)
        done = bench.run()
        if "this host was late" not in done.stderr:
            break
        bench.stop()
        shutil.rmtree(bench.runs)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["outcome"] == "kept"
    assert 1.7e-3 <= result["before"]["peak_error"] <= 2.2e-3
    assert 0.05e-3 <= result["after"]["peak_error"] <= 0.25e-3
    assert 0.3e-3 <= result["committed"]["peak_error"] <= 0.7e-3
    assert set(result["diagnosis"]["effects"]) == {"reversal_memory", "torque_ripple"}
    assert result["machine_seconds"] <= 300.0
    laws = result["adaptation"]["thesis"]
    assert laws["stiffness"] == pytest.approx(31.3, rel=0.15)
    assert laws["coulomb"] == pytest.approx(0.294, rel=0.15)
    assert laws["offset"] == pytest.approx(0.0482, rel=0.15)
    directory = bench.newest()
    assert json.loads((directory / "run.json").read_text()) == result
    for name in ("model.toml", "feedforward.toml", "report.html", "run.rrd", "journal.json"):
        assert (directory / name).stat().st_size > 100, name
    report = (directory / "report.html").read_text()
    for heading in ("Before and after", "Steady-state characteristics", "Presliding", "Dahl", "Adaptation"):
        assert heading in report
    proof = read_recording(directory / "recordings" / "proof.parquet")
    assert {"before", "after"} <= set(proof.experiment)
    assert int(proof.missed.sum()) == 0
    assert bench.last_state() == "SWITCH_ON_DISABLED"
    kept = read_drive(bench)
    assert kept["feedforward.enabled"] == 1.0
    assert {n: v for n, v in kept.items() if n.startswith("limit.")} == {
        n: v for n, v in present.items() if n.startswith("limit.")
    }
    back = called("rollback", str(bench.axis), "--runs", str(bench.runs))
    assert back.returncode == 0, back.stderr
    assert read_drive(bench) == pytest.approx(present)
