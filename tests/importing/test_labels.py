"""Files that say themselves which experiment a row belongs to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from autotune.core.errors import AutotuneError
from autotune.recordings.recording import Recording

from .conftest import Floats, bring_in

HEAD = "t [s],phase,run,pos [rad],tau [Nm]"
COLUMNS = ("time=t", "position=pos", "torque=tau")


def programme(signals: dict[str, Floats]) -> list[tuple[float, str, int, float, float]]:
    """2000 rows: sweep, sweep again, veto, and a stretch without a label."""
    labels = np.repeat(["sweep", "sweep", "veto", ""], 500)
    runs = np.repeat([0, 1, 0, 0], 500)
    return [
        (float(time), str(label), int(run), float(position), float(torque))
        for time, label, run, position, torque in zip(
            signals["time"], labels, runs, signals["position"], signals["torque"], strict=True
        )
    ]


def write(path: Path, rows: list[tuple[float, str, int, float, float]], head: str = HEAD) -> Path:
    lines = [head] + [f"{t:.6f},{label},{run},{q:.9g},{tau:.9g}" for t, label, run, q, tau in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def segments(recording: Recording) -> dict[tuple[str, int], int]:
    """Rows of each experiment and repeat."""
    found: dict[tuple[str, int], int] = {}
    for key in zip(recording.experiment.tolist(), recording.repeat.tolist(), strict=True):
        found[key] = found.get(key, 0) + 1
    return found


@pytest.mark.parametrize(
    "head", [HEAD.replace("phase,run", own) for own in ("experiment,repeat", "Experiment,Repeat")]
)
def test_a_recordings_own_names_are_taken_without_being_named(
    tmp_path: Path, signals: dict[str, Floats], head: str
) -> None:
    """Runs that follow one another without a pause were one long segment, and nothing said so."""
    brought = bring_in(write(tmp_path / "axis.csv", programme(signals), head), columns=COLUMNS)
    assert segments(brought.recording) == {
        ("sweep", 0): 500,
        ("sweep", 1): 500,
        ("veto", 0): 500,
        ("axis", 0): 500,
    }


@pytest.mark.parametrize("often", [1, 2000], ids=["every row", "never"])
def test_a_repeat_that_counts_nothing_is_left_out(
    tmp_path: Path, signals: dict[str, Floats], often: int
) -> None:
    """One that is the same everywhere would make repetitions of one number of files that are brought in together."""
    rows = [(*row[:2], 5 + number // often % 7, *row[3:]) for number, row in enumerate(programme(signals))]
    brought = bring_in(
        write(tmp_path / "axis.csv", rows, HEAD.replace("run", "repeat")),
        columns=(*COLUMNS, "experiment=phase"),
    )
    assert segments(brought.recording) == {("sweep", 0): 1000, ("veto", 0): 500, ("axis", 0): 500}
    assert any("repeat counts no repetitions" in line for line in brought.lines)


def test_labels_name_the_experiments(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write(tmp_path / "axis.csv", programme(signals))
    brought = bring_in(path, columns=(*COLUMNS, "experiment=phase", "repeat=run"))
    assert segments(brought.recording) == {
        ("sweep", 0): 500,
        ("sweep", 1): 500,
        ("veto", 0): 500,
        ("axis", 0): 500,
    }
    np.testing.assert_allclose(brought.recording["torque"], signals["torque"], rtol=1e-8)
    told = "\n".join(brought.lines)
    assert "experiment = 'phase': 2 labels, sweep, veto" in told
    assert "experiment 'veto' only gates a verdict" in told


def test_a_label_of_few_rows_is_told_by_its_row(tmp_path: Path, signals: dict[str, Floats]) -> None:
    """Its time has no gap, so that none is spoken of alone."""
    rows = programme(signals)
    rows[1000:1004] = [(t, "stop", *rest) for t, _, *rest in rows[1000:1004]]  # type: ignore[misc]
    brought = bring_in(
        write(tmp_path / "axis.csv", rows), columns=(*COLUMNS, "experiment=phase", "repeat=run")
    )
    told = next(line for line in brought.lines if "left out" in line)
    assert "fewer than 10 rows" in told
    assert "1, with 4 rows in all, from row 1001 on" in told
    assert "changes of experiment" in told


def test_a_column_with_the_recordings_own_name_is_taken(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write(tmp_path / "axis.csv", programme(signals), HEAD.replace("phase", "experiment"))
    assert ("veto", 0) in segments(bring_in(path, columns=COLUMNS).recording)


def test_who_names_all_segments_is_not_stopped_by_it(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write(tmp_path / "axis.csv", programme(signals), HEAD.replace("phase", "experiment"))
    assert segments(bring_in(path, columns=COLUMNS, experiment="day").recording) == {("day", 0): 2000}


def test_of_two_columns_of_one_name_the_command_keeps_the_number(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    path = write(tmp_path / "axis.csv", programme(signals), HEAD.replace("run", "Phase").replace(" [Nm]", ""))
    with pytest.raises(AutotuneError, match=r"--column experiment=2"):
        bring_in(path, columns=("experiment=2",))


def test_numbers_can_be_labels(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write(tmp_path / "axis.csv", programme(signals))
    found = segments(bring_in(path, columns=(*COLUMNS, "experiment=run")).recording)
    assert found == {("run_0", 0): 500, ("run_1", 0): 500, ("run_0-2", 0): 1000}


def test_texts_of_parquet(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = tmp_path / "axis.parquet"
    names = ("t", "phase", "run", "pos [rad]", "tau [Nm]")
    columns = dict(zip(names, map(list, zip(*programme(signals), strict=True)), strict=True))
    labels = [label or None for label in columns["phase"]]
    pyarrow.parquet.write_table(pa.table({**columns, "phase": labels}), path, row_group_size=300)
    wanted = ("time=t*s", "position=pos", "torque=tau", "experiment=phase", "repeat=run")
    found = segments(bring_in(path, kind="parquet", columns=wanted).recording)
    assert found == {("sweep", 0): 500, ("sweep", 1): 500, ("veto", 0): 500, ("axis", 0): 500}


def test_a_label_in_several_files_is_a_repetition_where_the_reference_is_the_same(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    head = "t [s],phase,run,pos [rad],tau [Nm],soll [rad]"
    paths = []
    for number, scale in enumerate((1.0, 1.0, 0.5)):
        path = tmp_path / f"day{number}.csv"
        rows = [
            f"{t:.6f},sine,0,{q:.9g},{tau:.9g},{scale * q:.9g}"
            for t, q, tau in zip(signals["time"], signals["position"], signals["torque"], strict=True)
        ]
        path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
        paths.append(path)
    wanted = (*COLUMNS, "experiment=phase", "reference=soll")
    found = segments(bring_in(*paths, columns=wanted).recording)
    assert found == {("sine", 0): 2000, ("sine", 1): 2000, ("sine-3", 0): 2000}


@pytest.mark.parametrize(
    ("columns", "options", "message"),
    [
        (("experiment=phases",), {}, "did you mean 'phase'"),
        (("experiment=pos",), {}, "no column of labels"),
        (("experiment=phase", "experiment=run"), {}, "twice"),
        (("experiment=phase",), {"experiment": "day"}, "leave one of the two out"),
        (("experiment=",), {}, "NAME=FIELD"),
    ],
)
def test_what_cannot_be_labels_is_said(
    tmp_path: Path,
    signals: dict[str, Floats],
    columns: tuple[str, ...],
    options: dict[str, str],
    message: str,
) -> None:
    path = write(tmp_path / "axis.csv", programme(signals))
    with pytest.raises(AutotuneError, match=message) as caught:
        bring_in(path, columns=(*COLUMNS, *columns), **options)
    assert caught.value.exit_code == 2


def test_the_command_that_asks_keeps_the_labels(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write(tmp_path / "axis.csv", programme(signals), HEAD.replace(" [Nm]", ""))
    with pytest.raises(AutotuneError, match=r"--column experiment=phase"):
        bring_in(path, columns=("experiment=phase",))
