"""What the documents point to is there, and every command line they show is one that the program has."""

from __future__ import annotations

import json
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import pytest
import typer
from pydantic import TypeAdapter

from autotune import __version__
from autotune.cli.main import COMMANDS, application, with_values
from autotune.service.views import Start

ROOT = Path(__file__).resolve().parents[2]
HIDDEN = re.compile(r"^\.|^(build|dist|runs|node_modules)$")
PAGES = sorted(
    path for path in ROOT.rglob("*.md") if not any(map(HIDDEN.match, path.relative_to(ROOT).parts[:-1]))
)
FOLDERS = re.compile(r"(?:autotune|bench|config|docs|drivers|sim|tests)/")
FILES = [
    str(path.relative_to(ROOT))
    for folder in ("autotune", "bench", "config", "docs", "drivers", "sim", "tests")
    for path in (ROOT / folder).rglob("*.*")
]
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
COMMAND = re.compile(r"(?:^|[\s'/])autotune\s+(?=[a-z-])(.*)$")
PLACEHOLDER = re.compile(r"[<\[{…]|\.\.\.")
CITED = re.compile(r"([A-Z][^()]{3,70}?),? ((?:18|19|20)\d\d)\b")


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def anchors(page: Path) -> set[str]:
    """Names of a page's headings as GitHub makes them: lower case, spaces as hyphens, no punctuation."""
    text = FENCED.sub("", page.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def broken(page: Path, text: str) -> list[str]:
    """Relative links that lead nowhere."""
    found = []
    for target in LINK.findall(FENCED.sub("", text)):
        if re.match(r"[a-z+]+:", target):
            continue
        name, _, anchor = target.partition("#")
        place = (page.parent / name).resolve() if name else page
        if not place.exists() or (anchor and anchor not in anchors(place)):
            found.append(target)
    return found


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    assert broken(page, page.read_text(encoding="utf-8")) == []


def test_a_link_to_a_missing_page_or_heading_is_found() -> None:
    page = ROOT / "README.md"
    text = (
        "[a](docs/none.md) [b](docs/service.md#none) [c](docs/service.md#the-service-file) [d](https://e.org)"
    )
    assert broken(page, text) == ["docs/none.md", "docs/service.md#none"]


def missing(text: str) -> list[str]:
    """Files of this project that are named and not there; a name may be short by the folders before it."""
    spans = INLINE.findall(FENCED.sub("", text))
    named_files = [span for span in spans if re.fullmatch(r"[\w./*-]+\.(?:py|md|toml|eds|yml|service)", span)]
    ours = [
        name for name in named_files if (name.endswith(".py") or FOLDERS.match(name)) and "NAME" not in name
    ]
    return [name for name in ours if not any(PurePosixPath(path).match(name) for path in FILES)]


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_file_that_is_named_is_there(page: Path) -> None:
    assert missing(page.read_text(encoding="utf-8")) == []


def test_a_file_that_has_moved_is_found() -> None:
    text = (
        "`diagnosis/starts.py` `starts.py` `identify/foreign.py` `moteus_*.py` `config/none.toml` `run.json`"
    )
    assert missing(text) == ["identify/foreign.py", "config/none.toml"]


def command_lines(text: str) -> Iterator[str]:
    """What stands behind `autotune` where the text shows a command: in shell blocks, and in code in a line."""
    blocks = [
        line for language, block in FENCED.findall(text) if language == "sh" for line in block.splitlines()
    ]
    for shown in [*blocks, *INLINE.findall(FENCED.sub("", text))]:
        found = COMMAND.search(shown.split(" #")[0].split(";")[0])
        if found and not shown.startswith(("useradd", "install", "adduser")):
            yield found[1].strip()


def unknown(command: Any, line: str) -> str:
    """What of a command line the program does not have; "" where it has all of it. Nothing is run.

    Words in capitals and brackets stand for something; where a line names options or arguments only in part, that
    is no mistake of its own.
    """
    words = with_values([word for word in shlex.split(line) if not word.startswith(("…", "..."))])
    while hasattr(command, "commands"):
        if not words:
            return ""
        if words[0].startswith("-"):
            break
        name = words.pop(0)
        if name not in command.commands:
            return name
        command = command.commands[name]
    options = {name: one for one in command.params for name in one.opts if name.startswith("-")}
    places = [one.nargs for one in command.params if not any(name.startswith("-") for name in one.opts)]
    given = 0
    while words:
        word, _, value = words.pop(0).partition("=")
        if not word.startswith("-") or PLACEHOLDER.match(word):
            given += 1
        elif word not in options and word != "--help":
            return word
        elif word in options and not getattr(options[word], "is_flag", False) and not value and words:
            words.pop(0)
    return f"{given} arguments" if given > len(places) and -1 not in places else ""


def whole() -> Any:
    """The program with every command loaded, each as it is when the command line names it."""
    program: Any = typer.main.get_command(application([]))
    for name in COMMANDS:
        alone: Any = typer.main.get_command(application([name]))
        program.commands[name] = alone.commands[name]
    return program


PROGRAM = whole()
LINES = sorted(
    {(named(page), line) for page in PAGES for line in command_lines(page.read_text(encoding="utf-8"))}
)


@pytest.mark.parametrize(("page", "line"), LINES)
def test_every_command_line_shown_is_one_of_the_program(page: str, line: str) -> None:
    assert unknown(PROGRAM, line) == ""


def test_a_command_or_option_that_does_not_exist_is_found() -> None:
    assert unknown(PROGRAM, "tune axis.toml") == "tune"
    assert unknown(PROGRAM, "model guess a.parquet") == "guess"
    assert unknown(PROGRAM, "run axis.toml --force") == "--force"
    assert unknown(PROGRAM, "model fit a.parquet b.parquet --out m.toml --json") == ""
    assert unknown(PROGRAM, "rollback one.toml two.toml") == "2 arguments"
    assert unknown(PROGRAM, "run axis.toml --resume") == ""


def test_command_lines_are_found_where_they_are_shown() -> None:
    text = "`autotune run A.toml --yes`\n```sh\n/opt/bin/autotune serve --check # why\n```\n`/etc/autotune`\n"
    assert list(command_lines(text)) == ["serve --check", "run A.toml --yes"]
    assert ("docs/walkthrough.md", "model show best.toml --html story.html") in LINES


def test_decisions_are_numbered_one_after_the_other_and_all_in_the_index() -> None:
    records = sorted(path.name for path in (ROOT / "docs/decisions").glob("[0-9]*.md"))
    assert [name[:5] for name in records] == [f"{number:04d}-" for number in range(1, len(records) + 1)]
    index = (ROOT / "docs/decisions/README.md").read_text(encoding="utf-8")
    assert [name for _, name in re.findall(r"^\| \[(\d{4})\]\((.*?)\)", index, re.MULTILINE)] == records


def test_the_newest_version_of_the_changelog_is_the_program_s() -> None:
    found = re.search(
        r"^## (?:Unreleased \()?(\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE
    )
    assert found is not None
    assert found[1] == __version__


def test_the_picture_and_the_page_have_every_floor_of_the_house() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    layers = next(one["layers"] for one in contracts["contracts"] if one["type"] == "layers")
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    picture = re.findall(
        r'font-weight="600"[^>]*>(\w+)<', (ROOT / "docs/pictures/architecture.svg").read_text()
    )
    rooms = [name.strip().removeprefix("autotune.") for layer in layers for name in layer.split("|")]
    names = list(dict.fromkeys(room.partition(".")[0] for room in rooms))
    assert picture == names
    for name in names:
        assert f"\n**{name}**" in page, name


def test_every_paper_that_the_code_cites_by_year_is_in_the_references() -> None:
    entries = (ROOT / "docs/references.md").read_text(encoding="utf-8").split("\n\n")
    cited = {
        (found[1], found[2])
        for package in ("autotune", "drivers", "sim")
        for path in (ROOT / package).rglob("*.py")
        for found in CITED.finditer(" ".join(path.read_text(encoding="utf-8").split('"""')[1:2]))
    }
    assert any("Iwan" in words for words, _ in cited)
    for words, year in sorted(cited):
        names = re.findall(r"[A-Z][a-zé]{3,}", words)
        assert any(year in entry and any(name in entry for name in names) for entry in entries), (words, year)


WISH = re.compile(r'`(\{"kind": .*?\})`')


def test_every_wish_that_is_shown_is_one_that_the_service_takes() -> None:
    shown = [json.loads(text) for text in WISH.findall((ROOT / "docs" / "service.md").read_text())]
    assert {one["kind"] for one in shown} == {"check", "run", "decide", "rollback"}
    for one in shown:
        named_backup = {**one, "to": "20260301-120000-1"} if "to" in one else one
        assert TypeAdapter(Start).validate_python(named_backup).kind == one["kind"]
