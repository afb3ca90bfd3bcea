"""Statistics of surfaces: Table 6.1 of the thesis, the density of asperities, and measured profiles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import dblquad, quad

from autotune.core.errors import ConfigurationError
from autotune.tribology.generated import generated_profile
from autotune.tribology.surface import (
    Surface,
    curvature_density,
    joint_density,
    surface_of_profile,
    together,
)

TABLE_6_1 = Surface(4.7185e-7, 0.5703, 3.4260e6)


def test_table_6_1() -> None:
    assert TABLE_6_1.bandwidth == pytest.approx(0.2464, abs=5e-5)
    assert TABLE_6_1.peak_density == pytest.approx(9.5611e5, rel=1e-4)


def test_the_joint_density_as_the_thesis_prints_it_integrates_to_one() -> None:
    def density(zeta: float, rho: float) -> float:
        return float(joint_density(np.array(zeta), np.array(rho), TABLE_6_1.bandwidth))

    # over κ = 1/ρ the integrand is smooth: ρ from 1/9 to 1000 leaves 3·10⁻⁷ of κ's density out
    total, _ = dblquad(lambda z, k: density(z, 1.0 / k) / k**2, 1e-3, 9.0, -8.0, 8.0, epsabs=1e-7)
    assert total == pytest.approx(1.0, abs=1e-5)


def test_the_split_density_is_the_printed_one() -> None:
    beta = TABLE_6_1.bandwidth
    for zeta, rho in ((0.3, 0.5), (2.0, 0.8), (-1.0, 2.0)):
        kappa = 1.0 / rho
        left = math.sqrt(1.0 - beta**2)
        normal = math.exp(-0.5 * ((zeta - beta * kappa) / left) ** 2) / (math.sqrt(2 * math.pi) * left)
        split = float(curvature_density(np.array(kappa))) * normal / rho**2
        assert float(joint_density(np.array(zeta), np.array(rho), beta)) == pytest.approx(split, rel=1e-12)


def test_moments_of_the_peaks() -> None:
    mean = quad(lambda k: k * float(curvature_density(np.array(k))), 0.0, 12.0)[0]
    square = quad(lambda k: k**2 * float(curvature_density(np.array(k))), 0.0, 12.0)[0]
    radius = math.sqrt(1.5) / (TABLE_6_1.curvature * mean)
    spread = math.sqrt(1.0 - TABLE_6_1.bandwidth**2 * (1.0 - square + mean**2))
    assert TABLE_6_1.mean_peak_radius == pytest.approx(radius, rel=1e-9)
    assert TABLE_6_1.peak_height_deviation == pytest.approx(TABLE_6_1.height * spread, rel=1e-9)


@pytest.mark.parametrize("values", [(0.0, 0.5, 3e6), (4.7e-7, math.nan, 3e6), (4.7e-7, 0.5, -1.0)])
def test_values_that_are_none(values: tuple[float, float, float]) -> None:
    with pytest.raises(ConfigurationError, match="must be above zero"):
        Surface(*values)


def test_statistics_that_no_surface_has() -> None:
    with pytest.raises(ConfigurationError, match=r"no Gaussian surface.*check the units"):
        Surface(4.7185e-7, 0.5703, 3.4260e5)  # curvature in another unit


def test_a_profile_gives_back_its_statistics() -> None:
    profile = generated_profile(TABLE_6_1, 20_000, np.random.default_rng(3))
    tilted = profile.height + 1e-3 * profile.position
    found = surface_of_profile(profile.position, tilted)
    assert found.height == pytest.approx(TABLE_6_1.height, rel=0.02)
    # central differences lose (2π/24)²/6 of a slope at the shortest wave, and 1/12 of that in curvature
    assert found.slope == pytest.approx(TABLE_6_1.slope, rel=0.02)
    assert found.curvature == pytest.approx(TABLE_6_1.curvature, rel=0.02)


def test_two_surfaces_together() -> None:
    both = together(TABLE_6_1, TABLE_6_1)
    assert both.height == pytest.approx(math.sqrt(2) * TABLE_6_1.height)
    assert both.bandwidth == pytest.approx(TABLE_6_1.bandwidth)  # of two alike


def test_profiles_that_are_none() -> None:
    x = np.arange(200) * 1e-7
    z = np.sin(1e7 * x) * 1e-7
    with pytest.raises(ConfigurationError, match="from point 100 to 101"):
        surface_of_profile(np.delete(x, slice(100, 110)), np.delete(z, slice(100, 110)))
    with pytest.raises(ConfigurationError, match="one unit"):
        surface_of_profile(np.where(np.arange(200) < 100, x, x * 1e3), z)
    with pytest.raises(ConfigurationError, match="point 6 is no finite number"):
        surface_of_profile(x, np.where(np.arange(200) == 5, np.nan, z))
    with pytest.raises(ConfigurationError, match="smooth plane"):
        surface_of_profile(x, np.zeros(200))
    with pytest.raises(ConfigurationError, match="at least 64"):
        surface_of_profile(x[:10], z[:10])
