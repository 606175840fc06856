"""A start with what is known of biases beforehand, and what they have done to a start that was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.biases.bias import Bias
from quietfix.systems.biases.biased import BiasedModel
from quietfix.systems.filters.whitening import Whitener, missing_rows, unknown_rows
from quietfix.systems.starts.start import Start

__all__ = ["BiasedStart"]

Array = NDArray[np.float64]


class BiasedStart(Start):
    r"""Any start, with biases behind: mean zero, variances as they are believed.

    A start from a measurement z inherits the biases of z. As it is made of rows with Jacobian H, noise R and
    derivative C by the biases, :math:`\hat x - x = e + F C b` with :math:`F = P H^T R^{-1}`, and with
    :math:`\hat b - b = -b`, :math:`\Sigma` the covariance of b,

    .. math:: P^+ = \begin{pmatrix} P + F C \Sigma C^T F^T & -F C \Sigma \\ -\Sigma C^T F^T & \Sigma\end{pmatrix}:

    the consider covariance of a least squares estimate (Bierman, *Factorization Methods for Discrete Sequential
    Estimation*, 1977, ch. VIII).

    Parameters
    ----------
    start : Start
        Of the target's state.
    biases : sequence of Bias
        In the order of the state behind it.
    stream : sequence of str
        Names of the rows on the measurement port.
    states : int
        Components of the target's state.

    Raises
    ------
    ValueError
        If the start uses a measurement and does not say how.
    """

    def __init__(self, start: Start, biases: Sequence[Bias], stream: Sequence[str], states: int) -> None:
        if start.uses_measurement and start.uses is None:
            raise ValueError(
                f"belief.biases: a start by {type(start).__name__} is not allowed with them; it does not say how "
                "biases of its measurement move it"
            )
        self.start, self.biases, self.states = start, tuple(biases), states
        self.uses_measurement, self.count = start.uses_measurement, start.count
        self.again = None if start.again is None else self if start.again is start else self._of(start.again, stream)
        self._variances = np.square([bias.sigma for bias in self.biases])
        self._model = None if start.uses is None else BiasedModel(start.uses, states, self.biases)
        rows = [] if start.uses is None else [list(stream).index(row) for row in start.uses.names]
        self._rows = np.array(rows, dtype=np.intp)
        self._width = len(stream)

    def _of(self, start: Start, stream: Sequence[str]) -> BiasedStart:
        return BiasedStart(start, self.biases, stream, self.states)

    @property
    def inputs(self) -> Mapping[str, int]:
        """See `Start`."""
        return self.start.inputs

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        mean, covariance = self.start.begin(measurement, platforms, inputs)
        zero = np.where(np.isfinite(mean).all(axis=-1, keepdims=True), 0.0, np.nan)
        state = np.concatenate([mean, np.broadcast_to(zero, (len(mean), len(self.biases)))], axis=-1)
        if self._model is None:
            return state, self._joined(covariance, None)
        noise = self._model.noise_covariance()
        if self.start.noise_input is not None:
            noise = inputs[self.start.noise_input].reshape(-1, self._width, self._width)
            noise = noise[:, self._rows[:, None], self._rows]
        gone = np.isnan(measurement[:, self._rows]) | unknown_rows(noise)
        return state, self._joined(covariance, self._slope(state, covariance, platforms, Whitener(noise), gone))

    def covariance_at(self, target: Array, platforms: Array) -> Array | None:
        """See `Start.covariance_at`."""
        covariance = self.start.covariance_at(target[..., : self.states], platforms)
        if covariance is None or self._model is None:
            return None if covariance is None else self._joined(covariance, None)
        whitener = Whitener(self._model.noise_covariance())
        return self._joined(covariance, self._slope(target, covariance, platforms, whitener, None))

    def _slope(
        self, state: Array, covariance: Array, platforms: Array, whitener: Whitener, gone: NDArray[np.bool_] | None
    ) -> Array:
        """Return F C, shape (..., n, k)."""
        assert self._model is not None
        n = self.states
        jacobian = self._model.jacobian(state, platforms)
        missing = missing_rows(jacobian.sum(axis=-1))
        if gone is not None and gone.any():
            missing = gone if missing is None else missing | gone
        if missing is not None:
            jacobian = np.where(missing[..., None], 0.0, jacobian)
        white = whitener.matrix(missing) @ jacobian
        slope: Array = covariance @ (np.swapaxes(white[..., :n], -1, -2) @ white[..., n:])
        return slope

    def _joined(self, covariance: Array, slope: Array | None) -> Array:
        n, k = self.states, len(self.biases)
        whole = np.zeros((*covariance.shape[:-2], n + k, n + k))
        whole[..., :n, :n] = covariance
        lost = ~np.isfinite(covariance).all(axis=(-1, -2), keepdims=True)
        whole[..., n:, n:] = np.where(lost, np.nan, np.diag(self._variances))
        if slope is not None and slope.any():
            cross = slope * self._variances
            whole[..., :n, :n] += cross @ np.swapaxes(slope, -1, -2)
            whole[..., :n, n:], whole[..., n:, :n] = -cross, -np.swapaxes(cross, -1, -2)
        return whole
