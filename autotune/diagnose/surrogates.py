"""Does a candidate beat chance? Residuals with the same spectrum but random phases say what chance can do.

On one trajectory smooth structure that has nothing to do with an effect can still follow its columns. A
candidate must lower the held-out error more than on nine of ten such surrogates.
"""

from __future__ import annotations

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.cross_validation import gain_and_z, held_out
from autotune.estimation.least_squares import Fitted
from autotune.estimation.problem import SEED, Study

COUNT = 20


def beats_surrogates(study: Study, base: Fitted, candidate: Fitted) -> bool:
    """Whether the candidate's columns explain more of the residual than of randomised ones."""
    count = base.jacobian.shape[1]
    columns = np.hstack([base.jacobian, candidate.jacobian[:, count:]])
    real = _gain(study, base.error, base.jacobian, columns)
    random = np.random.default_rng(SEED)
    chance = [
        _gain(study, _randomised(study, base.error, random), base.jacobian, columns) for _ in range(COUNT)
    ]
    return real > float(np.percentile(chance, 100.0 * study.policy.surrogates_beaten))


def _gain(study: Study, error: Floats, base: Floats, columns: Floats) -> float:
    return gain_and_z(held_out(study, error, base), held_out(study, error, columns))[0]


def _randomised(study: Study, error: Floats, random: np.random.Generator) -> Floats:
    order = np.argsort(study.data.grid, kind="stable")
    spectrum = np.fft.rfft(error[order])
    spectrum[1:] *= np.exp(2j * np.pi * random.uniform(size=len(spectrum) - 1))
    result = np.empty_like(error)
    result[order] = np.fft.irfft(spectrum, len(error))
    return result
