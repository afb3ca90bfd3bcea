"""A rough surface by the statistics of its heights, and the distribution of its asperities.

Heights are Gaussian with standard deviations s of height, ṡ of slope and s̈ of curvature (the roots of the
spectral moments m0, m2, m4 of a profile). Peaks have, made dimensionless by s and by ρ = R s̈/√1.5 (2.2), the
joint density (2.3). In place of the radius ρ its inverse κ = 1/ρ is used here: then (2.3) splits into

    p(κ) = √(6/π) (κ² − 1 + exp(−κ²)) exp(−κ²/2),    ζ | κ ~ normal(β κ, 1 − β²),    β = √1.5 ṡ²/(s s̈),

which integrates to one, and what is a polynomial of the height between two bounds has a closed form
(`contact.py`). (2.9): peaks per metre of profile, D_L = s̈/(2π ṡ).

Sources: thesis, section 2.1; Nayak, Trans. ASME J. Lubr. Technol. 93 (1971) 398, for m0, m2, m4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError

LEAST_POINTS = 64
"""Of a measured profile: fewer hold no statistics of peaks."""
_LARGEST_ASPECT = 0.05
"""Of the step between two measured points against their spacing's own unevenness: a hole in the profile."""


@dataclass(frozen=True)
class Surface:
    """The equivalent surface of a contact: the sum of both surfaces' heights, against a smooth plane.

    Args:
        height: s, standard deviation of height [m].
        slope: ṡ, standard deviation of slope [1].
        curvature: s̈, standard deviation of curvature [1/m].

    Raises:
        ConfigurationError: a value that is not positive, or three that no profile can have together.
    """

    height: float
    slope: float
    curvature: float

    def __post_init__(self) -> None:
        for name, value, unit in (
            ("height", self.height, "m"),
            ("slope", self.slope, "1"),
            ("curvature", self.curvature, "1/m"),
        ):
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigurationError(
                    f"surface: the standard deviation of {name} is {value:g} {unit}; it must be above zero"
                )
        if self.bandwidth >= 1.0:
            raise ConfigurationError(
                f"surface: height {self.height:g} m, slope {self.slope:g} and curvature {self.curvature:g} 1/m "
                f"belong to no Gaussian surface: √1.5·slope²/(height·curvature) is {self.bandwidth:.3g} and must be "
                "below 1; check the units, heights and lengths in metres"
            )

    @property
    def bandwidth(self) -> float:
        """β, the spectrum width parameter [1], below (2.3)."""
        return math.sqrt(1.5) * self.slope**2 / (self.height * self.curvature)

    @property
    def peak_density(self) -> float:
        """D_L, peaks per metre of profile [1/m], (2.9)."""
        return self.curvature / (2.0 * math.pi * self.slope)

    @property
    def mean_peak_radius(self) -> float:
        """√1.5/(s̈ E κ), the radius of a peak of mean curvature [m]."""
        mean = math.sqrt(6.0 / math.pi) * 4.0 / 3.0
        return math.sqrt(1.5) / (self.curvature * mean)

    @property
    def peak_height_deviation(self) -> float:
        """Standard deviation of peak heights [m]: of β κ + normal(0, 1 − β²), times s."""
        spread = 2.0 * math.sqrt(3.0) + 1.0 / 3.0 - 32.0 / (3.0 * math.pi)  # of κ: E κ² − (E κ)²
        return self.height * math.sqrt(1.0 - self.bandwidth**2 + self.bandwidth**2 * spread)


def curvature_density(inverse_radius: Floats) -> Floats:
    """p(κ) for κ ≥ 0: the density of dimensionless peak curvature in (2.3), [1]."""
    square = inverse_radius**2
    density: Floats = math.sqrt(6.0 / math.pi) * (square + np.expm1(-square)) * np.exp(-0.5 * square)
    return density


def joint_density(height: Floats, radius: Floats, bandwidth: float) -> Floats:
    """(2.3) itself, f(ζ, ρ), as the thesis prints it; for checks."""
    inverse = 1.0 / radius**2
    left = 1.0 - bandwidth**2
    shape = math.sqrt(3.0) * inverse / (math.pi * math.sqrt(left)) * (inverse + np.expm1(-inverse))
    exponent = height**2 - 2.0 * bandwidth * height / radius + inverse
    density: Floats = shape * np.exp(-0.5 / left * exponent)
    return density


def surface_of_profile(position: Floats, height: Floats) -> Surface:
    """The statistics of one measured profile, heights over position, both [m].

    A straight line is taken off first. Slope and curvature are central differences, as (2.9) means a profile as
    it was sampled: a finer stylus or step finds more and sharper peaks, so the step belongs to the result.

    Raises:
        ConfigurationError: too few points, a hole or a step back in position, values that are not finite, or no
            roughness at all.
    """
    _refuse_profile(position, height)
    step = float(position[-1] - position[0]) / (position.size - 1)
    rough = height - np.polyval(np.polyfit(position - position[0], height, 1), position - position[0])
    slope = (rough[2:] - rough[:-2]) / (2.0 * step)
    curvature = (rough[2:] - 2.0 * rough[1:-1] + rough[:-2]) / step**2
    return Surface(*(float(np.std(values)) for values in (rough, slope, curvature)))


def together(first: Surface, second: Surface) -> Surface:
    """The equivalent surface of two in contact: independent heights add, and so do their variances."""
    return Surface(
        math.hypot(first.height, second.height),
        math.hypot(first.slope, second.slope),
        math.hypot(first.curvature, second.curvature),
    )


def _refuse_profile(position: Floats, height: Floats) -> None:
    if position.size != height.size or position.size < LEAST_POINTS:
        raise ConfigurationError(
            f"profile: {position.size} positions and {height.size} heights; a profile needs at least {LEAST_POINTS} "
            "points, a position and a height each"
        )
    bad = ~(np.isfinite(position) & np.isfinite(height))
    if bad.any():
        raise ConfigurationError(
            f"profile: point {int(np.argmax(bad)) + 1} is no finite number; cut the profile where it has holes"
        )
    steps = np.diff(position)
    typical = float(np.median(steps))
    uneven = np.abs(steps - typical) > _LARGEST_ASPECT * abs(typical)
    if typical <= 0.0 or uneven.any():
        where = int(np.argmax(uneven)) if uneven.any() else 0
        raise ConfigurationError(
            f"profile: from point {where + 1} to {where + 2} position goes on by {steps[where]:g} m where "
            f"{typical:g} m is usual; a profile is sampled evenly and forwards: cut it at holes, and give all its "
            "positions in one unit"
        )
    if float(np.ptp(height)) == 0.0:
        raise ConfigurationError("profile: every height is the same; a smooth plane has no asperities")
