"""The service file, the example, housekeeping, and the systemd unit."""

from __future__ import annotations

import errno
import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from autotune.cli.main import main
from autotune.core.axis import read_axis
from autotune.core.errors import ConfigurationError
from autotune.core.paths import config_directory
from autotune.monitoring.check_plan import LONGEST_SECONDS, plan_check
from autotune.service.housekeeping import protected, prune, used
from autotune.service.settings import read_service
from autotune.tuning.results import run_folders

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"


def write(folder: Path, axes: dict[str, str], extra: str = "") -> Path:
    for name, link in axes.items():
        text = EXAMPLE.read_text().replace('name = "edm-vertical"', f'name = "{name}"')
        (folder / f"{name}.toml").write_text(
            text.replace("canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5", link)
        )
    blocks = "".join(f'[[axes]]\nfile = "{name}.toml"\n' for name in axes)
    path = folder / "service.toml"
    path.write_text(f'schema = 1\nruns = "{folder / "runs"}"\n{extra}\n{blocks}')
    return path


def test_the_example_is_right_and_simulated() -> None:
    (axis,) = read_service(config_directory() / "service.toml").axes
    assert axis.axis.link.startswith("sim://")


@pytest.mark.parametrize(
    "links",
    [("canopen+slcan:a.tty?bitrate=1000000&node=5", "canopen+slcan:./a.tty?node=5&bitrate=1000000"),
     ("canopen+socketcan://can0?node=5", "canopen+socketcan://can0/?node=05")],
)  # fmt: skip
def test_two_axes_on_one_node_are_refused(tmp_path: Path, links: tuple[str, str]) -> None:
    with pytest.raises(ConfigurationError, match="'one' and 'two' are on the same node"):
        read_service(write(tmp_path, {"one": links[0], "two": links[1]}))


def test_two_nodes_on_one_link_are_allowed(tmp_path: Path) -> None:
    links = {name: f"canopen+socketcan://can0?node={node}" for name, node in (("one", 5), ("two", 6))}
    assert len(read_service(write(tmp_path, links)).axes) == 2


def test_all_problems_are_named_together(tmp_path: Path) -> None:
    path = write(tmp_path, {"one": "sim://edm-vertical", "two": "sim://edm-vertical"})
    (tmp_path / "one.toml").write_text((tmp_path / "one.toml").read_text().replace("speed =", "sped ="))
    (tmp_path / "two.toml").unlink()
    with pytest.raises(ConfigurationError) as refused:
        read_service(path)
    assert "'limits.sped'" in str(refused.value)
    assert "there is no axis file" in str(refused.value)


@pytest.mark.parametrize(
    ("extra", "word"),
    [("[htp]\nport = 1", "'http'"), ("[http]\nport = 70000", "http.port"), ("at_once = 0", "at_once"),
     ('[history]\nurl = "no url"', "database URL"), ('[history]\nurl = "sqlite://"', "go with the process"),
     ('[history]\nurl = "sqlite:///:memory:"', "names no file"), ('[history]\nurl = "none://x/y"', "none://x/y"),
     ('[notices]\nwebhook = "ftp://x"', "webhook"), ("[recordings]\nbudget_megabytes = 1", "budget_megabytes")],
)  # fmt: skip
def test_a_wrong_key_or_value_is_named(tmp_path: Path, extra: str, word: str) -> None:
    with pytest.raises(ConfigurationError, match=word):
        read_service(write(tmp_path, {"one": "sim://edm-vertical"}, extra))


def test_the_check_fits_into_a_minute_and_stays_near_the_middle() -> None:
    axis = read_axis(EXAMPLE)
    plan = plan_check(axis)
    assert 10.0 < plan.duration <= LONGEST_SECONDS
    reach = abs(plan.legs.plan.reference).max()
    assert 0.1 < reach < 1.0  # the limits are ±20 rad
    usual = 2.0 * 3.1416 * axis.benchmark.frequency * axis.benchmark.amplitude
    assert abs(plan.legs.plan.velocity).max() <= 1.05 * usual


def folder(runs: Path, name: str, outcome: str, size: int, closed: bool = True) -> None:
    path = runs / name
    (path / "recordings").mkdir(parents=True)
    (path / "recordings" / "proof.parquet").write_bytes(bytes(size))
    (path / "run.json").write_text(json.dumps({"axis": "one", "outcome": outcome}))
    (path / "journal.json").write_text(json.dumps({"axis": "one", "outcome": outcome if closed else ""}))


def test_the_oldest_goes_first_and_what_a_commit_rests_on_never(tmp_path: Path) -> None:
    for number, outcome in enumerate(["kept", "kept", "kept", "not_applied", "not_applied", "not_applied"]):
        folder(tmp_path, f"2026030{number}-120000-one", outcome, 1000, closed=number != 3)
    removed = prune(tmp_path, ["one"], 4000)
    assert [path.name[:8] for path in removed] == ["20260300", "20260304"]
    assert used(tmp_path) == 4000
    assert (tmp_path / "20260300-120000-one" / "run.json").exists()
    assert [path.name[:8] for path in prune(tmp_path, ["one"], 0)] == ["20260305"]
    assert used(tmp_path) == 3000  # two commits and a run that has not ended


def test_a_folder_that_goes_while_it_is_looked_at_takes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(2):
        folder(tmp_path, f"2026030{number}-120000-one", "not_applied", 1000)
    found = Path.rglob

    def going(path: Path, pattern: str) -> Iterator[Path]:
        if "20260300" in str(path):
            raise FileNotFoundError(errno.ENOENT, "No such file or directory", str(path))
        return found(path, pattern)

    monkeypatch.setattr(Path, "rglob", going)
    assert used(tmp_path) == 1000
    assert [path.name[:8] for path in prune(tmp_path, ["one"], 0)] == ["20260301"]


def test_an_approved_commit_keeps_the_recordings_of_the_run_that_proposed_it(tmp_path: Path) -> None:
    names = [
        f"2026030{day}-120000-{axis}" for day, axis in ((1, "one"), (2, "not-one"), (3, "one"), (4, "one"))
    ]
    for name, outcome in zip(names, ("not_applied", "not_applied", "not_applied", "kept"), strict=True):
        folder(tmp_path, name, outcome, 1000)
    (tmp_path / names[1] / "model.toml").touch()
    (tmp_path / names[2] / "model.toml").touch()
    assert protected(tmp_path, ["one"]) == {names[2], names[3]}
    assert [path.name for path in run_folders(tmp_path, "one")] == [names[3], names[2], names[0]]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    unit = (config_directory() / "systemd" / "autotune.service").read_text()
    (tmp_path / "autotune.service").write_text(unit.replace("/opt/autotune/bin/autotune", "/bin/true"))
    done = subprocess.run(
        ["systemd-analyze", "verify", str(tmp_path / "autotune.service")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "autotune.service" not in done.stderr


def test_the_service_says_on_start_which_file_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("AUTOTUNE_SERVICE", raising=False)
    (tmp_path / "config").mkdir()
    path = write(tmp_path, {"one": "sim://edm-vertical"})
    path.rename(tmp_path / "config" / "service.toml")
    (tmp_path / "one.toml").rename(tmp_path / "config" / "one.toml")
    with pytest.raises(SystemExit) as ending:
        main(["serve", "--check"])
    assert not ending.value.code
    assert f"service file {tmp_path / 'config' / 'service.toml'}" in capsys.readouterr().err
