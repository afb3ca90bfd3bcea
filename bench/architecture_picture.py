"""Draws `docs/pictures/architecture.svg` from the layers in `pyproject.toml`; a part of `make pictures`."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORDS = {
    "cli": "arguments in, text and exit codes out",
    "api": "the public face, loaded by name from autotune",
    "service": "runs and checks without a person, year after year",
    "workbench": "recordings and models in a browser",
    "monitoring": "the daily check, drift, trend",
    "tuning": "the run: stages, proof, commit, journal, recovery",
    "view": "live traces, figures, report",
    "diagnosis": "what a model lacks",
    "experiments": "what the axis does, its guard",
    "export": "models for other controllers",
    "identify": "experiments to parameters",
    "control": "feedforward, adaptation, gains",
    "estimation": "data, controller, twin, residual, fits",
    "models": "effects, inverse, plant",
    "recordings": "files, importing, replay",
    "tribology": "rough contacts",
    "autotune_drivers": "CANopen, moteus, process",
    "signals": "excitation, filters, spectra",
    "autotune_sim": "a drive to tune, with its own physics",
    "core": "axis, drive, loop, errors",
}
LEFT, WIDTH, HEIGHT, STEP, GAP = 20, 700, 42, 48, 8


def floors() -> list[list[str]]:
    """Rooms by floor, top first; a room that has parts on several floors stands on the highest."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    layers = next(one["layers"] for one in contracts["contracts"] if one["type"] == "layers")
    seen: set[str] = set()
    rows = []
    for layer in layers:
        rooms = [name.strip().removeprefix("autotune.").partition(".")[0] for name in layer.split("|")]
        row = [room for room in dict.fromkeys(rooms) if room not in seen]
        seen.update(row)
        if row:
            rows.append(row)
    return rows


def drawn(rows: list[list[str]]) -> Iterator[str]:
    """Lines of the picture."""
    height = 14 + STEP * len(rows) + 8
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 820 {height}" width="820" height="{height}" '
        'role="img" font-family="system-ui, Segoe UI, Helvetica, Arial, sans-serif">'
    )
    yield "<title>The floors of autotune: imports only go down</title>"
    yield f'<rect width="820" height="{height}" fill="#ffffff"/>'
    for floor, row in enumerate(rows):
        top, wide = 14 + STEP * floor, (WIDTH - GAP * (len(row) - 1)) / len(row)
        for k, room in enumerate(row):
            left = LEFT + k * (wide + GAP)
            middle = left + wide / 2
            yield (
                f'<rect x="{left:g}" y="{top}" width="{wide:g}" height="{HEIGHT}" rx="4" fill="#eef3f8" '
                'stroke="#0072b2"/>'
            )
            yield (
                f'<text x="{middle:g}" y="{top + 17}" text-anchor="middle" font-size="14" font-weight="600" '
                f'fill="#1a1a1a">{room}</text>'
            )
            yield (
                f'<text x="{middle:g}" y="{top + 34}" text-anchor="middle" font-size="12" fill="#444444">'
                f"{WORDS[room]}</text>"
            )
    yield f'<path d="M760 20V{height - 24}" stroke="#d55e00" stroke-width="2"/>'
    yield f'<path d="M754 {height - 28}l6 12l6 -12z" fill="#d55e00"/>'
    yield (
        '<text x="778" y="323" transform="rotate(90 778 275)" text-anchor="middle" font-size="13" '
        'fill="#d55e00">may import</text>'
    )
    yield "</svg>"


def draw() -> None:
    """Writes the picture."""
    path = ROOT / "docs/pictures/architecture.svg"
    path.write_text("\n".join(drawn(floors())) + "\n", encoding="utf-8")


if __name__ == "__main__":
    draw()
