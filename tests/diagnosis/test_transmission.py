"""Between motor and load there is one transmission: a gap brings its own spring."""

from __future__ import annotations

import pytest

from autotune.diagnosis.transmission import OF_THE_GAP
from autotune.models import layout
from autotune.models.backlash import BACKLASH
from autotune.models.drive_model import Packed, base_model
from autotune.models.elastic_transmission import ELASTIC_TRANSMISSION
from autotune.models.transmission import coupling, load_shares

BASE = {
    "inertia": 5e-4, "viscous": 1e-3, "coulomb": 0.28, "stiffness": 100.0, "micro_damping": 0.05, "offset": 0.0,
}  # fmt: skip


def test_a_spring_beside_a_gap_is_the_contact_of_the_gap() -> None:
    packed = base_model(BASE).pack()
    p, on = packed.p.copy(), packed.on.copy()
    on[layout.flag(BACKLASH.name)] = True
    values = {"contact_compliance": 3e-3, "load_inertia": 0.4, "load_friction": 0.3, "damping": 0.1}
    p[BACKLASH.slot("gap")] = 4e-3
    for name, value in values.items():
        p[BACKLASH.slot(name)] = value
    both, on_both = p.copy(), on.copy()
    on_both[layout.flag(ELASTIC_TRANSMISSION.name)] = True
    for name, of_the_gap in OF_THE_GAP.items():
        both[ELASTIC_TRANSMISSION.slot(name)] = values[of_the_gap]
        both[BACKLASH.slot(of_the_gap)] = BACKLASH.parameter(of_the_gap).neutral
    alone, together = Packed(p, on), Packed(both, on_both)
    assert coupling(together.p, together.on) == pytest.approx(coupling(alone.p, alone.on))
    assert load_shares(together.p, together.on) == load_shares(alone.p, alone.on)
