"""Objects: how they are written, what they hold, how they travel."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError, LinkError
from autotune_drivers.canopen.objects import FORMATS, ObjectRef


def test_parses() -> None:
    ref = ObjectRef.parse("60B2:0A i16")
    assert (ref.index, ref.sub, ref.type, ref.size) == (0x60B2, 10, "i16", 2)
    assert ref.mapping() == 0x60B20A10
    assert str(ref) == "object 60B2h:0A"


@pytest.mark.parametrize(
    "text", ["", "6064", "6064:00", "6064:0 i32", "606G:00 i32", "6064:00 i33", "6064:00  i32"]
)
def test_refuses_what_is_not_an_object(text: str) -> None:
    with pytest.raises(ValueError, match="object"):
        ObjectRef.parse(text)


@given(st.sampled_from(sorted(FORMATS)), st.data())
def test_what_is_in_range_travels_unchanged(kind: str, data: st.DataObject) -> None:
    ref = ObjectRef(0x2000, 1, kind)
    low, high = ref.range
    if ref.is_float:
        width = 32 if kind == "f32" else 64
        value = data.draw(st.floats(allow_nan=False, allow_infinity=False, width=width))
    else:
        value = data.draw(st.integers(int(low), int(high)))
    assert ref.decode(ref.encode(ref.raw(value))) == value


@given(st.sampled_from(sorted(FORMATS)), st.floats())
def test_any_number_is_held_or_refused(kind: str, value: float) -> None:
    ref = ObjectRef(0x2000, 1, kind)
    low, high = ref.range
    try:
        raw = ref.raw(value)
    except ConfigurationError:
        assert not math.isfinite(value) or not low - 0.5 <= value <= high + 0.5
    else:
        assert low <= raw <= high
        assert abs(raw - value) <= (0.5 if not ref.is_float else 1e-7 * abs(value) + 1e-45)


def test_too_few_bytes_are_a_wrong_profile() -> None:
    with pytest.raises(LinkError, match="profile does not fit"):
        ObjectRef(0x6064, 0, "i32").decode(b"\1\2")


def test_filling_bytes_are_ignored() -> None:
    assert ObjectRef(0x6064, 0, "i16").decode(b"\xff\xff\0\0") == -1
