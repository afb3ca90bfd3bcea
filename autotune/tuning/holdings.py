"""What each kind of drive keeps by itself, and what only a host or an export can do: from its profile.

The same sentences stand in the README's table (a test compares them), before a run, and in its result.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from autotune.core.configuration import read_toml
from autotune.core.errors import ConfigurationError
from autotune.core.paths import config_directory

PREFIX = "feedforward."
FRICTION = {"coulomb", "stiffness", "break_away", "micro_damping"}
SHIPPED_FOR_TESTS = ("autotune-sim",)
"""How the profiles of simulated drives begin."""
EXPORTS = "c, linuxcnc, fmu, st, twincat-table or csv"


@dataclass(frozen=True, slots=True)
class Holding:
    """What a profile says: `keeps` and `needs_host` in words, both may be empty; `ripple`: it keeps that."""

    profile: str
    title: str
    keeps: tuple[str, ...]
    needs_host: tuple[str, ...]
    ripple: bool = False

    @property
    def nothing(self) -> bool:
        """The drive keeps none of what a run may find."""
        return not self.keeps


def nothing_kept(profile: str) -> str:
    """For a person, before anything moves: this drive holds no part of a feedforward."""
    return (
        f"This drive, with profile {profile}, keeps nothing of a feedforward: what the run finds acts only while a "
        f"host plays it, or in the controller that you export it to ({EXPORTS})."
    )


def export_step(directory: Path) -> str:
    """The next step where the drive keeps nothing, or not all."""
    return (
        f"Next step: 'autotune export {directory} --to c --out FOLDER' writes it for the controller that you have "
        f"(--to {EXPORTS})."
    )


def holding_of(profile: str, directory: Path | None = None) -> Holding | None:
    """What drives of a profile keep; None where the profile cannot be read (whoever opens the link says why)."""
    from autotune_drivers.profile import profile_path

    try:
        content = read_toml(profile_path(profile, directory), "profile")
    except ConfigurationError:
        return None
    return _holding(profile, content)


def _holding(profile: str, content: dict[str, Any]) -> Holding:
    names = {
        name.removeprefix(PREFIX) for name in content.get("parameters", {}) if str(name).startswith(PREFIX)
    }
    keeps, rest = [], []
    table = content.get("friction_table")
    if table:
        keeps.append(f"friction over velocity ({table['points']}-point table)")
        names |= {"coulomb", "viscous"}
    elastic = "LuGre friction" if names >= FRICTION else "friction with one spring rate"
    for words, there in (
        (elastic, {"coulomb", "stiffness"} <= names),
        ("Coulomb friction", not table and "coulomb" in names and "stiffness" not in names),
        ("viscous friction", not table and "viscous" in names),
        ("inertia", "inertia" in names),
        ("gravity", "offset" in names),
    ):
        if there:
            keeps.append(words)
    if "coulomb" not in names:
        rest.append("Coulomb friction")
    for words, name in (("viscous friction", "viscous"), ("inertia", "inertia")):
        if name not in names:
            rest.append(words)
    ripple = content.get("ripple")
    (keeps if ripple else rest).append(_ripple(ripple))
    needs_host = (*rest, "the diagnosed effects beyond")
    return Holding(profile, str(content.get("title", profile)), tuple(keeps), needs_host, bool(ripple))


def _ripple(entry: dict[str, Any] | None) -> str:
    if not entry:
        return "torque ripple"
    if entry.get("kind") == "steps":
        return f"torque ripple ({entry['points']}-point table)"
    return f"torque ripple ({entry['count']} harmonics up to order {entry['highest_order']})"


def shipped() -> list[Holding]:
    """All profiles of the program, real drives first."""
    found = [holding_of(path.stem) for path in sorted((config_directory() / "profiles").glob("*.toml"))]
    known = [one for one in found if one is not None]
    return sorted(known, key=lambda one: (one.profile.startswith(SHIPPED_FOR_TESTS), one.profile))


def readme_table() -> str:
    """The table on the README's first screen; Markdown."""
    rows = [
        f"| `{one.profile}` | {', '.join(one.keeps) or 'nothing'} | {', '.join(one.needs_host)} |"
        for one in shipped()
    ]
    head = "| profile | the drive keeps, without a host | needs the host, or an export |\n|---|---|---|"
    return "\n".join([head, *rows])
