"""The feedforward as one C99 file and its header; every other executable target wraps these two."""

from __future__ import annotations

from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.export.law import Law, feedforward_law
from autotune.export.printing import Language, assigned, called, printed
from autotune.export.request import FADE, Exported, Lost, Request, lost_everywhere
from autotune.export.self_test import SAMPLES, self_test_rows
from autotune.export.text import about, filled, headline

SOURCE, HEADER = "autotune_ff.c", "autotune_ff.h"
_LIBM = {"exp": "exp", "sin": "sin", "cos": "cos", "pow": "pow", "abs": "fabs"}
_COMPARED = {"min": "<", "max": ">"}
_FUNCTIONS = {name: f"FF_{name.upper()}" for name in (*_LIBM, *_COMPARED)}


def export_c(request: Request) -> Exported:
    """`autotune_ff.c` and `autotune_ff.h`."""
    law = feedforward_law(request.model, request.period)
    lost = lost_everywhere(request)
    files = {HEADER: _header(request, law, lost), SOURCE: _source(request, law, lost)}
    return Exported({name: text.encode("ascii") for name, text in files.items()}, lost, notes(request))


def notes(request: Request) -> tuple[str, ...]:
    """What a person should know of what every wrapper of this file does."""
    if request.torque_limit is not None:
        return ()
    return (
        "no torque limit is known: nothing limits what is put out but the drive; --torque-limit sets one",
    )


def quantity(request: Request) -> str:
    """What the motor gives: torque, force, current or voltage."""
    return {"N m": "torque", "N": "force", "A": "current", "V": "voltage"}[request.model.torque_symbol]


def _header(request: Request, law: Law, lost: tuple[Lost, ...]) -> str:
    states = [f"    AUTOTUNE_REAL {state.name}; /* {state.meaning} */" for state in law.states]
    used = [name for name in _LIBM.values() if name in _libm_of(law)]
    return filled(
        HEADER,
        headline=headline(request),
        about=about(request, lost, " * "),
        motion=request.model.motion_unit,
        quantity=quantity(request),
        torque=request.model.torque_symbol,
        period_ns=request.period_ns,
        libm=", ".join(used),
        states="\n".join(states),
        fade=f"{FADE:g}",
        expected=f"1e-14 {request.model.torque_symbol}",
    )


def _source(request: Request, law: Law, lost: tuple[Lost, ...]) -> str:
    language = _language(law)
    variables = [f"    AUTOTUNE_REAL {name};" for name in assigned(law)]
    unused = [] if "place" in assigned(law) else ["    (void)position;", ""]
    statements = unused + [
        line
        for block in law.blocks
        for line in (f"    /* {block.about} */", *printed(block.statements, language, 1), "")
    ]
    return filled(
        SOURCE,
        headline=headline(request),
        about=about(request, lost, " * "),
        quantity=quantity(request).capitalize(),
        torque=request.model.torque_symbol,
        float_functions="\n".join(_functions(law, "f")),
        double_functions="\n".join(_functions(law, "")),
        constants="\n".join(
            f"static const AUTOTUNE_REAL {c.name} = FF_R({c.value!r}); /* [{c.unit}] {c.meaning} */"
            for c in law.constants
        ),
        limits=_limit(request),
        saturation=_saturation(request),
        fade_step=repr(request.period / FADE),
        helpers="\n".join(_helpers(law)),
        variables="\n".join(variables),
        statements="\n".join(statements).rstrip(),
        relax="\n".join(f"    state->{state.name} = FF_R(0.0);" for state in law.states),
        samples=SAMPLES,
        vector=_rows(self_test_rows(request.model, request.period)),
    )


def _language(law: Law) -> Language:
    states = {state.name for state in law.states}
    return Language(
        assign="=",
        functions=_FUNCTIONS,
        number=lambda value: f"FF_R({value!r})",
        name=lambda name: f"state->{name}" if name in states else name,
        branch=lambda condition: f"if ({condition}) {{",
        otherwise="} else {",
        end="}",
    )


def _libm_of(law: Law) -> list[str]:
    return [_LIBM[name] for name in _LIBM if name in called(law)]


def _functions(law: Law, suffix: str) -> Iterator[str]:
    for name, function in _LIBM.items():
        if name in called(law):
            yield f"#define {_FUNCTIONS[name]} {function}{suffix}"


def _helpers(law: Law) -> Iterator[str]:
    for name, sign in _COMPARED.items():
        if name in called(law):
            yield (
                f"static AUTOTUNE_REAL {_FUNCTIONS[name]}(AUTOTUNE_REAL one, AUTOTUNE_REAL other)\n"
                f"{{\n    return (one {sign} other) ? one : other;\n}}\n"
            )


def _limit(request: Request) -> str:
    if request.torque_limit is None:
        return "/* No torque limit was given to the export: the drive's own acts. */"
    unit = request.model.torque_symbol
    return f"static const AUTOTUNE_REAL TORQUE_LIMIT = FF_R({request.torque_limit!r}); /* [{unit}] */"


def _saturation(request: Request) -> str:
    if request.torque_limit is None:
        return "    return torque;"
    return (
        "    AUTOTUNE_REAL most = (torque < TORQUE_LIMIT) ? torque : TORQUE_LIMIT;\n\n"
        "    return (most > -TORQUE_LIMIT) ? most : -TORQUE_LIMIT;"
    )


def _rows(vector: Floats) -> str:
    return ",\n".join("    {" + ", ".join(repr(float(value)) for value in row) + "}" for row in vector)
