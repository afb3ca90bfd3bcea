"""An axis file from what a drive says of itself and what a person answers; what nobody answered stays a question.

A question stands in the file as "?", which no command accepts: each says what is open instead of moving an axis
within limits that nobody has answered for. What the drive is set to now stands beside a question as information,
never as its answer.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from autotune.core.axis import Axis, Benchmark, Limits, Mechanics
from autotune.core.errors import ConfigurationError
from autotune.core.text import clean_line
from autotune_drivers.profile import profile_path
from autotune_drivers.seen import Seen

Ask = Callable[[str], str]
Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Question:
    """One key of the axis file that only a person can answer for."""

    section: str
    key: str
    unit: str
    words: str

    @property
    def name(self) -> str:
        return f"{self.section}.{self.key}" if self.section else self.key


QUESTIONS = (
    Question("", "motion_unit", "", "does the motor side turn ('rad') or slide ('m')"),
    Question("", "profile", "", "which profile is for this drive"),
    Question(
        "mechanics", "counts_per_revolution", "",
        "how many counts of the position sensor are one revolution; an axis that slides has counts_per_metre instead",
    ),
    Question("mechanics", "counts_per_metre", "", "how many counts of the position sensor are one metre"),
    Question("mechanics", "direction", "", "does the drive count up in the axis's positive sense (1) or down (-1)"),
    Question("limits", "position_min", "{u}", "how far may the axis go to the negative side, from the drive's zero"),
    Question("limits", "position_max", "{u}", "how far may the axis go to the positive side, from the drive's zero"),
    Question("limits", "speed", "{u}/s", "how fast may it go"),
    Question("limits", "torque", "{t}", "how much torque or force may it use"),
    Question("limits", "following_error", "{u}", "how far may it be from where it is told to be"),
    Question("limits", "deceleration", "{u}/s²", "with what can it brake at any time, loaded and warm"),
    Question("limits", "temperature", "°C", "how warm may the motor become"),
    Question("limits", "machine_seconds", "s", "how long may one run move it in all"),
    Question("benchmark", "amplitude", "{u}", "how wide is the sine on which improvement is proved, from its middle"),
    Question("benchmark", "frequency", "Hz", "how fast is that sine"),
)  # fmt: skip
_FIELDS: dict[str, type[BaseModel]] = {
    "mechanics": Mechanics,
    "limits": Limits,
    "benchmark": Benchmark,
    "": Axis,
}


@dataclass
class Draft:
    """What is known so far: answers by the key's whole name."""

    name: str
    seen: Seen
    values: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, name: str, seen: Seen) -> Draft:
        """With what the drive itself decides."""
        values: dict[str, Any] = {}
        if len(seen.profiles) == 1:
            values["profile"] = seen.profiles[0]
        if seen.motion_unit is not None:
            values["motion_unit"] = seen.motion_unit
        return cls(name, seen, values)

    def open(self) -> list[Question]:
        """Questions that are still to be answered."""
        return [one for one in QUESTIONS if one.name not in self.values and self._matters(one)]

    def answer(self, question: Question, text: str) -> str | None:
        """Takes an answer; what is wrong with it, in words, where it is none."""
        wrong = self._wrong(question, value := _value(text))
        if wrong is None:
            self.values[question.name] = value
            if question.key == "motion_unit" and value == "rad" and len(self.seen.counts) == 1:
                self.values["mechanics.counts_per_revolution"] = self.seen.counts[0]
        return wrong

    def _matters(self, question: Question) -> bool:
        unit = self.values.get("motion_unit")
        if question.key == "counts_per_revolution":
            return unit in (None, "rad") and not (unit == "rad" and len(self.seen.counts) == 1)
        return unit == "m" if question.key == "counts_per_metre" else True

    def _wrong(self, question: Question, value: Any) -> str | None:
        known = _FIELDS[question.section].model_fields[question.key]
        kind: Any = Annotated.__class_getitem__((known.annotation, known))  # type: ignore[attr-defined]
        allowed: TypeAdapter[Any] = TypeAdapter(kind)
        shown = f"{question.name} is {clean_line(repr(value), 60)}"
        if isinstance(value, float) and not math.isfinite(value):
            return f"{shown}: it must be a finite number"
        try:
            allowed.validate_python(value)
        except ValidationError as error:
            first = error.errors()[0]["msg"]
            return f"{shown}: {first[0].lower()}{first[1:]}"
        if question.key == "profile":
            return _unknown_profile(value)
        low = self.values.get("limits.position_min")
        if question.key == "position_max" and low is not None and value <= low:
            return f"limits.position_max is {value:g}; it must be above position_min, {low:g}"
        return None

    def told(self, question: Question) -> str:
        """What the drive says about it, in words; empty where it says nothing."""
        if question.key == "profile":
            return self._profiles()
        if question.key == "counts_per_revolution" and self.seen.counts:
            return (
                f"the drive counts {' or '.join(f'{one:.9g}' for one in self.seen.counts)} in one revolution"
            )
        value = self.seen.limits.get(f"limit.{question.key}") if question.section == "limits" else None
        unit = self.values.get("motion_unit")
        if value is None or unit == "m":
            return ""
        of = question.unit.format(u="rad", t="N m")
        return f"the drive is set to {value:.6g} {of} now" + (", if the axis turns" if unit is None else "")

    def _profiles(self) -> str:
        if self.seen.profiles:
            return f"for this drive there are {', '.join(self.seen.profiles)}"
        return (
            "none knows this drive; 'cia402' is the general one of CANopen drives, to be checked against the "
            "drive's manual, or write one of your own (my-drive.toml, begun from config/profiles)"
        )

    def unit(self, question: Question) -> str:
        """The unit of the answer; both while it is open whether the axis turns."""
        known = self.values.get("motion_unit")
        both = [question.unit.format(u=u, t=t) for u, t in (("rad", "N m"), ("m", "N")) if known in (None, u)]
        return " or ".join(dict.fromkeys(both))


def ask_all(draft: Draft, ask: Ask, say: Say) -> None:
    """Asks for everything that is open; an empty answer leaves it open."""
    left: set[str] = set()
    while remaining := [one for one in draft.open() if one.name not in left]:
        question = remaining[0]
        unit, told = draft.unit(question), draft.told(question)
        text = ask(
            f"{question.name}: {question.words}"
            + (f" [{unit}]" if unit else "")
            + (f" ({told})" if told else "")
            + "? "
        ).strip()
        if not text:
            left.add(question.name)
            continue
        wrong = draft.answer(question, text)
        if wrong is not None:
            say(wrong)


def text_of(draft: Draft) -> str:
    """The axis file."""
    identity = draft.seen.identity
    who = ", ".join(
        f"{name} {value:#010x}" if isinstance(value, int) else f"{name} {clean_line(value, 60)}"
        for name, value in identity.items()
        if value not in ("", 0)
    )
    lines = [
        f"# Written by 'autotune init'. The drive said: {who or 'nothing of itself'}.",
        '# SI units, motor side. "?" is a question: write the answer in its place.',
        "# A person answers for every limit: no experiment goes beyond them.",
        *(f"# {clean_line(remark)}." for remark in draft.seen.remarks),
        "schema = 1",
        f"name = {json.dumps(draft.name)}",
        f"link = {json.dumps(draft.seen.link)}",
    ]
    for section in ("", "mechanics", "limits", "benchmark"):
        if section:
            lines += ["", f"[{section}]"]
        lines += _section(draft, section)
    return "\n".join(lines) + "\n"


def _section(draft: Draft, section: str) -> list[str]:
    lines = []
    waiting = {one.name for one in draft.open()}
    for question in (one for one in QUESTIONS if one.section == section):
        unit, told = draft.unit(question), draft.told(question)
        if question.name in draft.values:
            value = draft.values[question.name]
            shown = json.dumps(value) if isinstance(value, str) else f"{value:.12g}"
            lines.append(f"{question.key} = {shown}" + (f" # {unit}" if unit else ""))
        elif question.name in waiting:
            words = question.words + (f" [{unit}]" if unit else "") + (f"; {told}" if told else "")
            lines.append(f'{question.key} = "?" # {words}')
    return lines


def _value(text: str) -> Any:
    try:
        number = float(text)
    except ValueError:
        return text
    return int(number) if math.isfinite(number) and number.is_integer() else number


def _unknown_profile(name: str) -> str | None:
    if name.endswith(".toml"):
        return None  # of the user's own; whoever reads the axis file looks for it
    try:
        profile_path(name)
    except ConfigurationError as error:
        return str(error)
    return None
