"""Load, real area and tangential stiffness of a rough contact, summed over its asperities.

Each asperity is a half cylinder (lay across the motion: milled, ground) or a cap (isotropic: lapped, blasted),
pressed in by δ = s (ζ − t) where the smooth plane stands at the dimensionless height t (2.1):

    line    P = ¼ L π E* (2δ − δ²/R)      A = 2 L √(δ (2R − δ))     σ = 2 G L/π          (2.8), (2.16)
    point   P = 4/3 E* √R δ^1.5           A = π R δ                 σ = 4 G a/(2 − ν)    (2.6), Mindlin

and the interface is the mean over (2.3) times the number of asperities, (2.7), (2.12), (2.17).

Where the thesis is not followed: an asperity cannot be pressed in by more than its radius, so that P, A and σ are
held at δ = R. Without this (2.8) falls again beyond δ = R, and on the thesis's own surface (s s̈ = 1.6) the load
is negative below t = 2.2. (2.11) has √(δ (R − δ)), which contradicts the geometry of (2.8): a² = 2Rδ − δ².

Sources: thesis, sections 2.1 and 2.3.2; Greenwood and Williamson, Proc. R. Soc. A 295 (1966) 300, for the
plasticity index; Nayak (1971) for summits per area; Mindlin, J. Appl. Mech. 16 (1949) 259.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.tribology.surface import Surface, curvature_density

Geometry = Literal["line", "point"]
LOWEST, HIGHEST = -3.0, 8.0
"""Of the plane's dimensionless height: 99.9 % of all asperities touch, and one in 10¹⁵."""
_MOST_CURVED = 9.0
"""Of κ: p(κ) is below 10⁻¹⁵ beyond."""
_KAPPA, _KAPPA_WEIGHT = np.polynomial.legendre.leggauss(160)
_DEPTH, _DEPTH_WEIGHT = np.polynomial.legendre.leggauss(48)

PerAsperity = Callable[[Floats, Floats], Floats]
"""(δ [m], R [m]) → load [N], area [m²] or stiffness [N/m] of one asperity, for 0 ≤ δ ≤ R."""


@dataclass(frozen=True)
class Material:
    """Of both bodies: Young's modulus E [Pa], Poisson's ratio ν, and hardness H [Pa] of the softer (nan: unknown)."""

    young_modulus: float
    poisson_ratio: float
    hardness: float = math.nan

    @property
    def contact_modulus(self) -> float:
        """E* of two equal bodies [Pa], (2.4)."""
        return self.young_modulus / (2.0 * (1.0 - self.poisson_ratio**2))

    @property
    def shear_modulus(self) -> float:
        """G [Pa]."""
        return self.young_modulus / (2.0 * (1.0 + self.poisson_ratio))


@dataclass(frozen=True)
class Interface:
    """A rough contact: surface, material, shape of asperities, and the apparent area.

    Args:
        width: b, along the motion [m]: asperities are counted over it.
        length: L, across the motion [m].
    """

    surface: Surface
    material: Material
    width: float
    length: float
    geometry: Geometry = "line"

    @property
    def asperities(self) -> float:
        """N [1]: D_L b on a lay (2.10), summits per area times the area where there is none."""
        if self.geometry == "line":
            return self.surface.peak_density * self.width
        per_area = self.surface.curvature**2 / self.surface.slope**2 / (6.0 * math.pi * math.sqrt(3.0))
        return per_area * self.width * self.length

    def load(self, height: float) -> float:
        """P_z [N] with the plane at the dimensionless height t, (2.7)."""
        return self.asperities * _mean(self.surface, height, self._load_of_one)

    def area(self, height: float) -> float:
        """A_r, real area of contact [m²], (2.12)."""
        return self.asperities * _mean(self.surface, height, self._area_of_one)

    def stiffness(self, height: float) -> float:
        """σ0, tangential stiffness at rest [N/m], (2.17)."""
        return self.asperities * _mean(self.surface, height, self._stiffness_of_one)

    def touching(self, height: float) -> float:
        """Share of the asperities that touch [1]."""
        return _mean(self.surface, height, lambda depth, radius: np.ones_like(depth * radius))

    def height_at(self, load: float) -> float:
        """The plane's dimensionless height t that carries `load` [N].

        Raises:
            ConfigurationError: a load that asperities alone cannot carry, or less than one of them carries.
        """
        most, least = self.load(LOWEST), self.load(HIGHEST)
        if not least < load < most:
            area = 1e6 * self.width * self.length
            raise ConfigurationError(
                f"contact: a load of {load:g} N on {area:.3g} mm² is outside what the asperities of this surface "
                f"carry ({least:.3g} to {most:.3g} N): the bulk of the bodies would carry it, and this theory of "
                "single asperities says nothing; check load and area"
            )
        return float(
            scipy.optimize.brentq(lambda t: math.log(self.load(t) / load), LOWEST, HIGHEST, xtol=1e-10)
        )

    def _load_of_one(self, depth: Floats, radius: Floats) -> Floats:
        modulus = self.material.contact_modulus
        if self.geometry == "line":
            return 0.25 * self.length * math.pi * modulus * (2.0 * depth - depth**2 / radius)
        return 4.0 / 3.0 * modulus * np.sqrt(radius * depth**3)

    def _area_of_one(self, depth: Floats, radius: Floats) -> Floats:
        if self.geometry == "line":
            return 2.0 * self.length * np.sqrt(depth * (2.0 * radius - depth))
        return math.pi * radius * depth

    def _stiffness_of_one(self, depth: Floats, radius: Floats) -> Floats:
        shear = self.material.shear_modulus
        if self.geometry == "line":
            return np.full_like(depth * radius, 2.0 * shear * self.length / math.pi)
        return 4.0 * shear * np.sqrt(radius * depth) / (2.0 - self.material.poisson_ratio)


def plasticity_index(surface: Surface, material: Material) -> float:
    """ψ = E*/H √(σ_peaks/R) [1]: below 0.6 asperities stay elastic at any usual load, above 1 they yield at any."""
    roughness = surface.peak_height_deviation / surface.mean_peak_radius
    return material.contact_modulus / material.hardness * math.sqrt(roughness)


def stiffness_exponent(interface: Interface, lightest: float, heaviest: float, points: int = 25) -> float:
    """n of σ0 ∝ P_z^n between two loads [N]: slope of a line through log σ0 over log P_z."""
    loads = np.geomspace(lightest, heaviest, points)
    stiffness = [interface.stiffness(interface.height_at(load)) for load in loads]
    return float(np.polyfit(np.log(loads), np.log(stiffness), 1)[0])


def _mean(surface: Surface, height: float, one: PerAsperity) -> float:
    """∫∫ one(s (ζ − t), R) f(ζ, ρ) dρ dζ over ζ > t; `one` held at its value at δ = R for deeper asperities.

    For each κ the height is normal with mean β κ: the part up to δ = R by Gauss's rule (where R is larger than
    any height, up to nine standard deviations), the part beyond in closed form.
    """
    kappa = 0.5 * _MOST_CURVED * (_KAPPA + 1.0)
    weight = 0.5 * _MOST_CURVED * _KAPPA_WEIGHT * curvature_density(kappa)
    radius = math.sqrt(1.5) / (surface.curvature * kappa)
    centre, spread = surface.bandwidth * kappa, math.sqrt(1.0 - surface.bandwidth**2)
    deepest = np.minimum(radius, surface.height * np.maximum(centre + 9.0 * spread - height, 1e-9))
    depth = 0.5 * deepest[:, None] * (_DEPTH + 1.0)
    zeta = height + depth / surface.height
    chance = np.exp(-0.5 * ((zeta - centre[:, None]) / spread) ** 2) / (math.sqrt(2.0 * math.pi) * spread)
    values = one(depth, radius[:, None]) * chance
    inner = 0.5 * deepest / surface.height * (values @ _DEPTH_WEIGHT)
    full = one(radius[:, None], radius[:, None])[:, 0]
    beyond = full * scipy.special.ndtr((centre - height - radius / surface.height) / spread)
    return float(weight @ (inner + beyond))
