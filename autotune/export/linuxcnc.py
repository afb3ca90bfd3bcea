"""A HAL component for LinuxCNC round the C file, with the lines that wire it.

`halcompile` turns pins into macros, so that none of them may be called as anything in the C file is; a
trailing underscore keeps them apart and is not part of a pin's name. The header's contents stand in the
component, so that it is one file.
"""

from __future__ import annotations

from autotune.export.c_file import HEADER, SOURCE, export_c, quantity
from autotune.export.request import FADE, Exported, Request
from autotune.export.text import about, filled, headline

COMPONENT, HAL, LCEC = "autotune_ff.comp", "autotune_ff.hal", "autotune_ff.lcec.xml"
_INCLUDE = f'#include "{HEADER}"'


def export_linuxcnc(request: Request) -> Exported:
    """`autotune_ff.comp` with its header, HAL lines, and a fragment of an lcec configuration."""
    c = export_c(request)
    source = c.files[SOURCE].decode("ascii").replace(_INCLUDE, "")
    words = {
        "headline": headline(request),
        "quantity": quantity(request),
        "motion": request.model.motion_unit,
        "torque": request.model.torque_symbol,
        "period_ns": request.period_ns,
        "fade": f"{FADE:g}",
        "rated": "0.0" if request.rated_torque is None else repr(request.rated_torque),
    }
    component = filled(COMPONENT, about=about(request, c.lost, ""), source=source, **words)
    texts = {COMPONENT: component, HAL: filled(HAL, **words), LCEC: filled(LCEC, **words)}
    files = {name: text.encode("ascii") for name, text in texts.items()}
    return Exported(files | {HEADER: c.files[HEADER]}, c.lost, c.notes)
