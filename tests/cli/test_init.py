"""`autotune init`: what is told is taken, what a person answers for is asked, and nothing is guessed."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from autotune.cli import init as command
from autotune.cli.axis_draft import Draft, ask_all, text_of
from autotune.cli.main import main
from autotune.core.axis import read_axis
from autotune.core.errors import ConfigurationError
from autotune_drivers import seen as seen_module
from autotune_drivers.seen import Adapter, Seen

SEEN = Seen(
    "canopen+slcan:///dev/ttyACM0?bitrate=1000000&node=5",
    {"vendor": 0xFB, "name": "EPOS4\x1b[2J", "firmware": "1.7"},
    ("maxon-epos4",), (4096.0,), {"limit.speed": 50.0},
)  # fmt: skip
ANSWERS = {
    "motion_unit": "rad", "mechanics.direction": "1", "limits.position_min": "-20", "limits.position_max": "20",
    "limits.speed": "20", "limits.torque": "1.34", "limits.following_error": "0.15", "limits.deceleration": "400",
    "limits.temperature": "80", "limits.machine_seconds": "300", "benchmark.amplitude": "0.2",
    "benchmark.frequency": "1",
}  # fmt: skip


def test_whoever_answers_everything_has_a_whole_axis_file(tmp_path: Path) -> None:
    draft, said = Draft.of("pump", SEEN), []
    ask_all(draft, lambda words: ANSWERS[words.split(":")[0]], said.append)
    assert not said
    assert not draft.open()
    (tmp_path / "pump.toml").write_text(text_of(draft))
    axis = read_axis(tmp_path / "pump.toml")
    assert axis.profile == "maxon-epos4"
    assert axis.mechanics.counts_per_revolution == 4096
    assert axis.limits.speed == 20.0
    assert "\x1b" not in text_of(draft)


def test_what_nobody_answers_stands_as_a_question_that_no_command_accepts(tmp_path: Path) -> None:
    draft = Draft.of("pump", SEEN)
    asked: list[str] = []

    def silent(words: str) -> str:
        asked.append(words)
        return ""

    ask_all(draft, silent, lambda words: None)
    assert {words.split(":")[0] for words in asked} >= set(ANSWERS)
    assert any("the drive is set to 50 rad/s now" in words for words in asked)
    (tmp_path / "pump.toml").write_text(text_of(draft))
    with pytest.raises(ConfigurationError) as refused:
        read_axis(tmp_path / "pump.toml")
    for key in ANSWERS:
        assert key in str(refused.value)


@pytest.mark.parametrize(
    ("key", "wrong"),
    [("limits.speed", "fast"), ("limits.speed", "-1"), ("limits.speed", "nan"), ("limits.torque", "inf"),
     ("limits.position_max", "-30"), ("mechanics.direction", "0"), ("motion_unit", "deg"),
     ("benchmark.frequency", "50"), ("limits.temperature", "500")],
)  # fmt: skip
def test_a_senseless_answer_is_said_and_asked_again(key: str, wrong: str) -> None:
    draft, said, asked = Draft.of("pump", SEEN), [], []

    def person(words: str) -> str:
        name = words.split(":")[0]
        asked.append(name)
        return wrong if name == key and asked.count(name) == 1 else ANSWERS[name]

    ask_all(draft, person, said.append)
    assert len(said) == 1
    assert said[0].startswith(f"{key} is")
    assert asked.count(key) == 2
    assert draft.values[key] != wrong


def test_several_profiles_and_countings_are_asked_about() -> None:
    draft = Draft.of("pump", Seen("x", {}, ("one", "two"), (4096.0, 1000.0)))
    draft.answer(draft.open()[0], "rad")
    open_keys = {one.key for one in draft.open()}
    assert {"profile", "counts_per_revolution"} <= open_keys
    assert "counts_per_metre" not in open_keys


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as ending:
        main(["init", *arguments])
    seen = capsys.readouterr()
    assert "Traceback" not in seen.err
    return int(ending.value.code or 0), seen.err + seen.out


def test_a_file_that_is_there_is_never_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.toml").write_text("mine")
    code, text = told(capsys, "--at", "canopen+slcan:x?bitrate=1000000", "--out", str(tmp_path / "a.toml"))
    assert (code, (tmp_path / "a.toml").read_text()) == (2, "mine")
    assert "is there already" in text


def test_without_a_link_it_says_what_is_plugged_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = str(tmp_path / "a.toml")
    monkeypatch.setattr(seen_module, "adapters", list)
    assert "no USB serial port is plugged in" in told(capsys, "--out", out)[1]
    port = Adapter("/dev/ttyACM0", "somebody's adapter", None)
    monkeypatch.setattr(seen_module, "adapters", lambda: [port])
    code, text = told(capsys, "--out", out)
    assert code == 2
    assert (
        "--at 'canopen+slcan:///dev/ttyACM0?bitrate=1000000' or --at 'moteus+serial:///dev/ttyACM0'" in text
    )


def test_one_of_several_drives_must_be_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(seen_module, "look", lambda link, folder: [SEEN, SEEN])
    code, text = told(capsys, "--at", "x", "--out", str(tmp_path / "a.toml"))
    assert code == 2
    assert "2 drives answer" in text
    assert command.init.__doc__


def test_a_written_file_names_what_is_open(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(seen_module, "look", lambda link, folder: [SEEN])
    monkeypatch.setattr("sys.stdin", io.StringIO())
    code, text = told(capsys, "--at", "x", "--out", str(tmp_path / "Pump 3.toml"))
    assert code == 0
    assert "open questions" in text
    assert 'name = "pump-3"' in (tmp_path / "Pump 3.toml").read_text()
