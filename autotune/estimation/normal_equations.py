"""The linear algebra of the joint refinement: weighted instrumental normal equations.

With residual e, sensitivities S (of the measured motion) and instruments Z (of a simulated one, whose
noise is independent), the step solves ZᵀW(e + S·δ) = 0. The covariance is the sandwich
A⁻¹·B·A⁻ᵀ, A = ZᵀWS, B = Σ over blocks of g·gᵀ with the scores g = ZᵀWe of each block: blocks of about
a second keep the correlation of coloured residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats

BLOCK_SECONDS = 1.0
WHITENING_ORDER = 6
STEP_PRIOR, ERROR_PRIOR = 1.0, 30.0
"""Standard deviations of what is thought of a parameter before, in units of its scale."""


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal equations in scaled parameters.

    Attributes:
        matrix: A = ZᵀWS, shape (k, k); score: ZᵀWe, shape (k,).
        blocks: scores of the blocks, shape (b, k).
    """

    matrix: Floats
    score: Floats
    blocks: Floats

    @property
    def step(self) -> Floats:
        """Change of the parameters that zeroes the score.

        A weak prior (no change, give or take the parameter's scale) keeps directions that the data say
        nothing about where they are; the others do not feel it.
        """
        return np.asarray(-self._inverse(STEP_PRIOR) @ self.score)

    @property
    def covariance(self) -> Floats:
        """Sandwich covariance of the parameters, shape (k, k); huge in directions that nothing tells."""
        inverse = self._inverse(ERROR_PRIOR)
        count = len(self.blocks)
        meat = self.blocks.T @ self.blocks * (count / max(count - len(self.score), 1))
        return np.asarray(inverse @ (meat + np.eye(len(self.score)) / ERROR_PRIOR**2) @ inverse.T)

    def weak_directions(self, least: float) -> list[Floats]:
        """Unit vectors in scaled parameters whose information is below `least` times the largest."""
        symmetric = 0.5 * (self.matrix + self.matrix.T)
        values, vectors = np.linalg.eigh(symmetric)
        return [
            vectors[:, i] for i in range(len(values)) if values[i] < least * max(float(values[-1]), 1e-300)
        ]

    def _inverse(self, prior: float) -> Floats:
        return np.asarray(np.linalg.inv(self.matrix + np.eye(len(self.score)) / prior**2))


@dataclass(frozen=True, slots=True)
class Part:
    """What one piece contributes.

    Attributes:
        error: e, shape (m,); sensitivity, instrument: S and Z, shape (m, k).
        block: rows in a block.
        weight: of its squares; None takes the inverse of the error's variance.
    """

    error: Floats
    sensitivity: Floats
    instrument: Floats
    block: int
    weight: float | None = None


def whitener(error: Floats, order: int = WHITENING_ORDER) -> Floats:
    """Prediction-error filter (1, a1, …) of a residual by the Yule–Walker equations, shape (order + 1,)."""
    centred = error - error.mean()
    count = len(centred)
    if count < 20 * order or not np.any(centred):
        return np.ones(1)
    lags = [float(np.dot(centred[: count - lag], centred[lag:])) / count for lag in range(order + 1)]
    correlation = np.array(lags)
    correlation[0] *= 1.0 + 1e-6
    solution = scipy.linalg.solve_toeplitz(correlation[:-1], correlation[1:])
    return np.concatenate([[1.0], -np.asarray(solution)])


def assemble(parts: list[Part]) -> Normal:
    """Normal equations of all pieces, each weighted by the inverse of its own variance."""
    size = parts[0].sensitivity.shape[1]
    matrix, score = np.zeros((size, size)), np.zeros(size)
    blocks: list[Floats] = []
    for part in parts:
        weight = part.weight
        if weight is None:
            spread = float(np.std(part.error)) if len(part.error) else 0.0
            if spread == 0.0:
                continue
            weight = spread**-2.0
        matrix += weight * part.instrument.T @ part.sensitivity
        products = weight * part.instrument * part.error[:, None]
        score += products.sum(axis=0)
        count = max(1, round(len(part.error) / part.block))
        edges = np.linspace(0, len(part.error), count + 1).astype(int)[:-1]
        blocks.append(np.add.reduceat(products, edges, axis=0))
    return Normal(matrix, score, np.vstack(blocks) if blocks else np.zeros((1, size)))
