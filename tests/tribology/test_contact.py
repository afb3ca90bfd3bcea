"""Contacts of rough surfaces: closed forms against brute force, the thesis's figures, and limits."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.optimize import brentq

from autotune.core.errors import ConfigurationError
from autotune.tribology.contact import Interface, Material, plasticity_index, stiffness_exponent
from autotune.tribology.generated import Profile, direct_contact, generated_profile
from autotune.tribology.surface import Surface, joint_density

SURFACE = Surface(4.7185e-7, 0.5703, 3.4260e6)
STEEL = Material(210e9, 0.3, 6e9)
BEARING = Interface(SURFACE, STEEL, width=1e-3, length=20e-3)
LAPPED = Interface(Surface(5e-8, 0.02, 2e4), STEEL, width=5e-3, length=5e-3, geometry="point")


@pytest.mark.parametrize("height", [0.5, 2.5])
def test_the_load_is_the_double_integral(height: float) -> None:
    """(2.7) with the printed density, by a library's rule, clipped at δ = R."""
    modulus = STEEL.contact_modulus

    def integrand(zeta: float, kappa: float) -> float:
        radius = math.sqrt(1.5) / (kappa * SURFACE.curvature)
        depth = min(SURFACE.height * (zeta - height), radius)
        load = 0.25 * math.pi * BEARING.length * modulus * (2 * depth - depth**2 / radius)
        density = float(joint_density(np.array(zeta), np.array(1.0 / kappa), SURFACE.bandwidth))
        return load * density / kappa**2

    brute = dblquad(integrand, 1e-2, 8.0, height, 9.0, epsabs=0.0, epsrel=1e-5)[0]
    assert BEARING.load(height) == pytest.approx(BEARING.asperities * brute, rel=1e-4)


def test_every_quantity_falls_as_the_plane_is_lifted() -> None:
    """Without clipping at δ = R the load of this surface is negative below t = 2.2."""
    for interface in (BEARING, LAPPED):
        for of in (interface.load, interface.area, interface.stiffness):
            values = [of(t) for t in np.linspace(-2.5, 5.0, 31)]
            assert all(a > b > 0.0 for a, b in pairwise(values))


def test_stiffness_grows_almost_with_the_load() -> None:
    """Loads over which a tenth of a per cent to a few per cent of the asperities touch."""
    assert 0.92 <= stiffness_exponent(BEARING, 30.0, 15_000.0) <= 0.97


def test_stiffness_at_a_load_does_not_depend_on_the_apparent_area() -> None:
    wide = Interface(SURFACE, STEEL, width=2e-3, length=20e-3)
    one, two = (i.stiffness(i.height_at(100.0)) for i in (BEARING, wide))
    assert two == pytest.approx(one, rel=2.0**0.08 - 1.0)  # ∝ area^(1 − n), n ≥ 0.92


@pytest.fixture(scope="module")
def profile() -> Profile:
    return generated_profile(SURFACE, 200_000, np.random.default_rng(5))


@pytest.mark.parametrize("load", [1000.0, 5000.0])  # hundreds of peaks touch: counted within a few per cent
def test_a_generated_surface_carries_the_same(load: float, profile: Profile) -> None:
    """Peaks counted one by one, with the heights and curvatures that they have."""
    plane = float(
        brentq(lambda z: direct_contact(BEARING, profile, z)[0] - load, 0.0, 5 * SURFACE.height, xtol=1e-11)
    )
    _, area, stiffness = direct_contact(BEARING, profile, plane)
    at = BEARING.height_at(load)
    assert stiffness == pytest.approx(BEARING.stiffness(at), rel=0.15)
    assert area == pytest.approx(BEARING.area(at), rel=0.15)


def test_hertz_point_contact_of_one_cap() -> None:
    """P = 4/3 E* √R δ^1.5, A = π R δ, tangential stiffness 4 G a/(2 − ν)."""
    depth, radius = np.array([1e-8]), np.array([1e-5])
    contact = math.sqrt(1e-5 * 1e-8)
    load = LAPPED._load_of_one(depth, radius)[0]
    assert contact**3 == pytest.approx(3 * load * 1e-5 / (4 * STEEL.contact_modulus))
    assert LAPPED._area_of_one(depth, radius)[0] == pytest.approx(math.pi * contact**2)
    assert LAPPED._stiffness_of_one(depth, radius)[0] == pytest.approx(
        4 * STEEL.shear_modulus * contact / 1.7
    )


def test_plasticity_index_tells_lapped_from_milled() -> None:
    assert plasticity_index(SURFACE, STEEL) > 10.0
    assert plasticity_index(LAPPED.surface, STEEL) < 1.5


@pytest.mark.parametrize("load", [1e7, 1e-12])
def test_a_load_that_asperities_do_not_carry(load: float) -> None:
    with pytest.raises(ConfigurationError, match="check load and area"):
        BEARING.height_at(load)
