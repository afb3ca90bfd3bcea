"""Readable numbers: SI multiples, significant digits, fewer points for the same picture."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats

_MULTIPLES = ((1e-9, "n"), (1e-6, "µ"), (1e-3, "m"), (1.0, ""))
_SCALABLE = frozenset({"rad", "m", "N m", "N", "A", "V", "s", "N m/rad", "rad/s", "m/s"})


def multiple(largest: float, unit: str) -> tuple[float, str]:
    """Factor and unit that bring `largest` (in `unit`) to 1…1000, such as (1e3, "mrad").

    Only multiples below one are used, and only for units where they are customary: kg m² stays.
    """
    if unit not in _SCALABLE or not math.isfinite(largest) or largest <= 0:
        return 1.0, unit
    size, prefix = next(
        ((s, p) for s, p in reversed(_MULTIPLES) if largest >= 0.999 * s),
        _MULTIPLES[0],
    )
    return 1.0 / size, prefix + unit


def peak(*arrays: Floats | None) -> float:
    """Largest finite magnitude in the arrays; 0 where there is none."""
    best = 0.0
    for values in arrays:
        if values is not None and np.size(values):
            finite = np.abs(values[np.isfinite(values)])
            best = max(best, float(finite.max()) if finite.size else 0.0)
    return best


def significant(value: float, digits: int = 3) -> str:
    """`value` with so many significant digits, as people write it.

    >>> significant(31.27), significant(-0.0049), significant(0.00066612)
    ('31.3', '−0.00490', '6.66 × 10⁻⁴')
    """
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = _exponent(value, digits)
    if exponent < -3 or exponent > 5:
        return f"{signed(value / 10.0**exponent, digits - 1)} {_power(exponent)}"
    return signed(value, max(0, digits - 1 - exponent))


def quantity(value: float, unit: str, error: float | None = None) -> str:
    """A value with unit and, where known, an error, in one multiple.

    The error has two digits and the value is rounded at the error's last digit.

    >>> quantity(0.00049, "rad"), quantity(0.316, "N m", 0.0042), quantity(6.7e-4, "kg m²", 1e-5)
    ('490 µrad', '316.0 ± 4.2 mN m', '(6.70 ± 0.10) × 10⁻⁴ kg m²')
    """
    if error is None or not math.isfinite(error) or error <= 0 or not math.isfinite(value):
        factor, text = multiple(abs(value), unit)
        return f"{significant(value * factor)} {text}".strip()
    factor, text = multiple(max(abs(value), error), unit)
    value, error = value * factor, error * factor
    exponent = _exponent(max(abs(value), error), 3)
    shift = exponent if exponent < -3 or exponent > 5 else 0
    value, error = value / 10.0**shift, error / 10.0**shift
    decimals = min(9, max(0, 1 - _exponent(error, 2)))
    both = f"{signed(value, decimals)} ± {error:.{decimals}f}"
    return f"({both}) {_power(shift)} {text}".strip() if shift else f"{both} {text}".strip()


def signed(value: float, decimals: int) -> str:
    """Fixed notation with a real minus sign."""
    return f"{value:.{decimals}f}".replace("-", "−")


def continuous(time: Floats, period: float) -> Floats:
    """Time that always runs on: where it does not (recordings joined, a clock restarted), by one period."""
    step = np.diff(time, prepend=time[:1])
    step[1:] = np.where(step[1:] <= 0, period, step[1:])
    return np.asarray(time[:1].sum() + np.cumsum(step), dtype=np.float64)


def _exponent(value: float, digits: int) -> int:
    """Decimal exponent of the value once rounded to so many digits."""
    return int(f"{abs(value):.{digits - 1}e}".rpartition("e")[2])


def _power(exponent: int) -> str:
    return "× 10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def thin(y: Floats, points: int = 1100) -> NDArray[np.int64]:
    """Rows that draw the same line as all rows: smallest and largest `y` of each slot, and both ends.

    Args:
        y: ordinate, shape (n,); gaps (nan) are kept as gaps.
        points: rows at most, about.
    Returns:
        row numbers, ascending, shape (≤ points + 2,).
    """
    rows = len(y)
    if rows <= points:
        return np.arange(rows)
    slots = max(1, points // 2)
    length = math.ceil(rows / slots)
    padded = np.full(slots * length, np.nan)
    padded[:rows] = y
    table = padded.reshape(slots, length)
    start = np.arange(slots) * length
    low = start + np.argmin(np.where(np.isnan(table), np.inf, table), axis=1)
    high = start + np.argmax(np.where(np.isnan(table), -np.inf, table), axis=1)
    chosen = np.unique(np.concatenate([[0, rows - 1], low, high]))
    return np.asarray(chosen[chosen < rows], dtype=np.int64)


def thin_path(x: Floats, y: Floats, points: int = 1500) -> NDArray[np.int64]:
    """Rows that draw the same curve in a plane (a hysteresis loop): evenly spaced along its length.

    x and y are measured in units of their own ranges. Returns ascending row numbers.
    """
    rows = len(x)
    if rows <= points:
        return np.arange(rows)
    steps = np.hypot(_relative_steps(x), _relative_steps(y))
    length = np.concatenate([[0.0], np.cumsum(steps)])
    if not length[-1] > 0:
        return np.array([0, rows - 1])
    wanted = np.linspace(0.0, length[-1], points)
    chosen = np.unique(np.concatenate([[0, rows - 1], np.searchsorted(length, wanted)]))
    return np.asarray(chosen[chosen < rows], dtype=np.int64)


def binned(x: Floats, y: Floats, bins: int = 40) -> tuple[Floats, Floats, Floats]:
    """Mean of y in bins of x, with its standard error; bins with fewer than three rows are left out.

    Returns:
        centres, means and standard errors, each of shape (≤ bins,).
    """
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if x.size < 3 or not np.ptp(x) > 0:
        return np.empty(0), np.empty(0), np.empty(0)
    edges = np.linspace(x.min(), x.max(), bins + 1)
    slot = np.clip(np.digitize(x, edges) - 1, 0, bins - 1)
    count = np.bincount(slot, minlength=bins)
    full = count >= 3
    mean = np.bincount(slot, y, bins)[full] / count[full]
    square = np.bincount(slot, y * y, bins)[full] / count[full]
    error = np.sqrt(np.maximum(square - mean * mean, 0.0) / (count[full] - 1))
    centre = np.bincount(slot, x, bins)[full] / count[full]
    return centre, mean, error


def _relative_steps(values: Floats) -> Floats:
    filled = np.nan_to_num(values)
    span = float(np.ptp(filled)) or 1.0
    return np.asarray(np.abs(np.diff(filled)) / span, dtype=np.float64)
