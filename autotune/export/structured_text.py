"""The feedforward as an IEC 61131-3 function block in structured text: the statements of the C file, printed anew."""

from __future__ import annotations

from autotune.export.c_file import notes, quantity
from autotune.export.law import Law, feedforward_law
from autotune.export.printing import Language, assigned, printed
from autotune.export.request import FADE, Exported, Request, lost_everywhere
from autotune.export.text import about, filled, headline

BLOCK = "autotune_ff.st"
_FUNCTIONS = {
    "exp": "EXP", "sin": "SIN", "cos": "COS", "pow": "EXPT", "abs": "ABS", "min": "MIN", "max": "MAX",
}  # fmt: skip


def export_st(request: Request) -> Exported:
    """`autotune_ff.st`: one function block, LREAL."""
    law = feedforward_law(request.model, request.period)
    lost = lost_everywhere(request)
    text = filled(
        BLOCK,
        headline=headline(request),
        about=about(request, lost, "   "),
        quantity=quantity(request).capitalize(),
        motion=request.model.motion_unit,
        torque=request.model.torque_symbol,
        period_ns=request.period_ns,
        fade=f"{FADE:g}",
        fade_step=_number(request.period / FADE),
        constants="\n".join(
            f"    {_prefixed(c.name)} : LREAL := {_number(c.value)}; (* [{c.unit}] {c.meaning} *)"
            for c in law.constants
        ),
        limit=_number(1e300 if request.torque_limit is None else request.torque_limit),
        states="\n".join(f"    {s.name} : LREAL; (* {s.meaning} *)" for s in law.states),
        variables="\n".join(f"    {_local(name)} : LREAL;" for name in assigned(law)),
        statements="\n".join(_statements(law)),
        relax="\n".join(f"        {state.name} := 0.0;" for state in law.states),
    )
    return Exported({BLOCK: text.encode("ascii")}, lost, notes(request))


def _statements(law: Law) -> list[str]:
    return [
        line
        for block in law.blocks
        for line in (f"    (* {block.about} *)", *printed(block.statements, _language(law), 1))
    ]


def _language(law: Law) -> Language:
    states = {state.name for state in law.states}

    def name(own: str) -> str:
        if own in states or own in ("position", "velocity", "acceleration"):
            return own
        return _prefixed(own) if own.isupper() else _local(own)

    return Language(":=", _FUNCTIONS, _number, name, lambda test: f"IF {test} THEN", "ELSE", "END_IF;")


def _prefixed(constant: str) -> str:
    """ST knows no case: constants and variables need names that differ otherwise."""
    return f"C_{constant}"


def _local(variable: str) -> str:
    return f"x_{variable}"


def _number(value: float) -> str:
    """A real literal: a decimal point is obligatory, an exponent has E."""
    text = repr(value)
    mantissa, _, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return f"{mantissa}E{int(exponent)}" if exponent else mantissa
