"""The linear algebra of the joint refinement: weighted instrumental normal equations.

With residual e, sensitivities S (of the measured motion) and instruments Z (of a simulated one, whose
noise is independent), the step solves ZᵀW(e + S·δ) = 0. Blocks of about a second keep the correlation of coloured
residuals. The covariance is the jackknife over them: what the solution would be with one block left out,
δ = A⁻¹·(1 − A_b·A⁻¹)⁻¹·g_b with A = ZᵀWS and the block's score g_b = Z_bᵀW_b·e_b. The sandwich A⁻¹·(Σ g_b·g_bᵀ)·A⁻ᵀ is
too small where a few blocks tell most of a parameter, because they bend the fit to themselves (Bell and McCaffrey,
Survey Methodology 28, 2002).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats

BLOCK_SECONDS = 1.0
WHITENING_ORDER = 6
LEAST_FREEDOM = 4.0
"""Of a standard error that one block nearly makes: its weight says how large the score of a block may be."""
STEP_PRIOR, ERROR_PRIOR = 1.0, 30.0
"""Standard deviations of what is thought of a parameter before, in units of its scale."""


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal equations in scaled parameters.

    Attributes:
        matrix: A = ZᵀWS, shape (k, k); score: ZᵀWe, shape (k,).
        blocks: scores of the blocks, shape (b, k); `matrices`: what each adds to A, shape (b, k, k).
    """

    matrix: Floats
    score: Floats
    blocks: Floats
    matrices: Floats

    @property
    def step(self) -> Floats:
        """Change of the parameters that zeroes the score.

        A weak prior (no change, give or take the parameter's scale) keeps directions that the data say
        nothing about where they are; the others do not feel it.
        """
        return np.asarray(-self._inverse(STEP_PRIOR) @ self.score)

    def step_on(self, rows: Floats, values: Floats) -> Floats:
        """The `step` for which rows·step = values, shapes (c, k) and (c,): what else can move zeroes its score."""
        matrix = self.matrix + np.eye(len(self.score)) / STEP_PRIOR**2
        there, along = np.linalg.pinv(rows) @ values, scipy.linalg.null_space(rows)
        slope = along.T @ (self.score + matrix @ there)
        return np.asarray(there - along @ np.linalg.solve(along.T @ matrix @ along, slope))

    @property
    def covariance(self) -> Floats:
        """Jackknife covariance of the parameters, shape (k, k); huge in directions that nothing tells."""
        inverse, changes, count = self._inverse(ERROR_PRIOR), self._without_a_block(), len(self.blocks)
        spread = changes.T @ changes * ((count - 1) / count if count > 1 else 1.0)
        return np.asarray(spread + inverse @ inverse.T / ERROR_PRIOR**2)

    @property
    def freedom(self) -> Floats:
        """Degrees of freedom of each parameter's standard error, shape (k,): as many as there are blocks that tell it.

        Satterthwaite's (Σs²)²/Σs⁴ of the blocks' variances s², with c² and c⁴/3 of their Gaussian parts c in place of
        s² and s⁴; n equal blocks give n on average.
        """
        squares = self._without_a_block() ** 2
        alike = np.sum(squares, axis=0) ** 2 / np.maximum(np.sum(squares**2, axis=0), 1e-300)
        most = max(float(len(self.blocks) - len(self.score)), LEAST_FREEDOM)
        return np.asarray(np.clip(3.0 * alike - 2.0, LEAST_FREEDOM, most))

    def _without_a_block(self) -> Floats:
        """By how much the parameters change where one block is left out, shape (b, k)."""
        inverse = self._inverse(ERROR_PRIOR)
        rest = np.eye(len(self.score)) - self.matrices @ inverse
        return np.asarray(np.linalg.solve(rest, self.blocks[:, :, None])[:, :, 0] @ inverse.T)

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
    count = len(error)
    if count < 20 * order:
        return np.ones(1)
    centred = error - error.mean()
    if not np.any(centred):
        return np.ones(1)
    lags = [float(np.dot(centred[: count - lag], centred[lag:])) / count for lag in range(order + 1)]
    correlation = np.array(lags)
    correlation[0] *= 1.0 + 1e-6
    solution = scipy.linalg.solve_toeplitz(correlation[:-1], correlation[1:])
    return np.concatenate([[1.0], -np.asarray(solution)])


def assemble(parts: list[Part]) -> Normal:
    """Normal equations of all pieces, each weighted by the inverse of its own variance."""
    size = parts[0].sensitivity.shape[1]
    blocks: list[Floats] = []
    matrices: list[Floats] = []
    for part in parts:
        weight = part.weight
        if weight is None:
            spread = float(np.std(part.error)) if len(part.error) else 0.0
            if spread == 0.0:
                continue
            weight = spread**-2.0
        count = max(1, round(len(part.error) / part.block))
        for rows in np.array_split(np.arange(len(part.error)), count):
            inside = slice(int(rows[0]), int(rows[-1]) + 1)
            weighted = weight * part.instrument[inside].T
            matrices.append(weighted @ part.sensitivity[inside])
            blocks.append(weighted @ part.error[inside])
    if not blocks:
        blocks, matrices = [np.zeros(size)], [np.zeros((size, size))]
    return Normal(np.sum(matrices, axis=0), np.sum(blocks, axis=0), np.array(blocks), np.array(matrices))
