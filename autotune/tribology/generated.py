"""A rough profile made from its statistics, and the contact of that very profile: a check of the integrals.

The profile is a sum of many waves with random phases, with a power spectrum ∝ 1/q² between two wave numbers that
give the three moments asked for. Its peaks are counted one by one, with the height and the curvature that each has:
no distribution of asperities is assumed, only the law of one of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.tribology.contact import Interface
from autotune.tribology.surface import Surface

POINTS_A_WAVE = 24
"""Of the shortest wave: a parabola through three points then has a peak's curvature within 1 %."""


@dataclass(frozen=True)
class Profile:
    """Heights [m] every `step` [m]."""

    step: float
    height: Floats

    @property
    def position(self) -> Floats:
        """[m], from zero on."""
        return np.arange(self.height.size, dtype=np.float64) * self.step


def generated_profile(surface: Surface, waves: int, generator: np.random.Generator) -> Profile:
    """A periodic profile with the moments of `surface`, `waves` shortest wavelengths long.

    Raises:
        ConfigurationError: moments that a spectrum ∝ 1/q² cannot have.
    """
    low, high = _wave_numbers(surface)
    step = 2.0 * math.pi / high / POINTS_A_WAVE
    points = waves * POINTS_A_WAVE
    q = 2.0 * math.pi * np.fft.rfftfreq(points, step)
    inside = (q >= low) & (q <= high)
    amplitude = np.where(inside, 1.0 / np.maximum(q, low), 0.0)
    spectrum = amplitude * np.exp(2j * math.pi * generator.random(q.size))
    height = np.fft.irfft(spectrum, points)
    return Profile(step, height * surface.height / float(np.std(height)))


def direct_contact(interface: Interface, profile: Profile, plane: float) -> tuple[float, float, float]:
    """Load [N], real area [m²] and stiffness [N/m] of the apparent width, of the profile's own peaks.

    Args:
        plane: height [m] of the smooth plane above the profile's mean.
    """
    z = profile.height
    before, after = np.roll(z, 1), np.roll(z, -1)
    peak = (z > before) & (z >= after)
    curvature = (2.0 * z[peak] - before[peak] - after[peak]) / profile.step**2
    lean = 0.5 * (after[peak] - before[peak]) / profile.step
    depth = z[peak] + 0.5 * lean**2 / curvature - plane
    depth, radius = depth[depth > 0.0], 1.0 / curvature[depth > 0.0]
    depth = np.minimum(depth, radius)
    width = interface.width / (profile.step * z.size)
    return (
        width * float(interface._load_of_one(depth, radius).sum()),
        width * float(interface._area_of_one(depth, radius).sum()),
        width * float(interface._stiffness_of_one(depth, radius).sum()),
    )


def _wave_numbers(surface: Surface) -> tuple[float, float]:
    """Lowest and highest wave number [1/m] of a spectrum ∝ 1/q² with the surface's moments m0, m2, m4."""
    wanted = (surface.height * surface.curvature / surface.slope**2) ** 2

    def ratio(r: float) -> float:  # m0 m4/m2² for q from 1 to r
        return (1.0 - 1.0 / r) * (r**3 - 1.0) / 3.0 / (r - 1.0) ** 2

    if not ratio(1.0001) < wanted < ratio(1e5):
        raise ConfigurationError(
            f"surface: moments with m0 m4/m2² of {wanted:.3g} have no spectrum of the form 1/q²"
        )
    r = float(scipy.optimize.brentq(lambda x: ratio(x) - wanted, 1.0001, 1e5))
    # m2/m0 = low² (r − 1)/(1 − 1/r) = low² r
    low = surface.slope / surface.height / math.sqrt(r)
    return low, low * r
