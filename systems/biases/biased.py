"""A measurement model whose rows have biases that are states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.biases.bias import Bias, Turn
from quietfix.systems.biases.wrapping import biased_equations
from quietfix.systems.geometry.misalignment import rotation_matrix, seen_from_turned_axes, turned_derivatives
from quietfix.systems.kernels.equations import Equations, equations_of, program
from quietfix.systems.kernels.evaluating import linearized, values
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["BiasedModel"]

Array = NDArray[np.float64]


class BiasedModel(MeasurementModel):
    r"""Any model, with biases behind the target's state.

    .. math:: h(x, b) = h_0\big(x'(x, b)\big) + C\,b

    C adds; x' is what a well-aligned sensor would have to see, `seen_from_turned_axes`, for the rows of a platform
    whose axes are turned by some of the biases; for the others x' = x.

    Parameters
    ----------
    model : MeasurementModel
        The rows without biases.
    states : int
        n, how many components the target's state has.
    biases : sequence of Bias
        In the order of the state behind it. Rows that the model does not have are left out.
    """

    def __init__(self, model: MeasurementModel, states: int, biases: Sequence[Bias]) -> None:
        self.model, self.states, self.biases = model, states, tuple(biases)
        self.names, self.units = tuple(model.names), tuple(model.units)
        shares = np.zeros((len(self.names), len(self.biases)))
        turned: dict[int, tuple[Turn, list[int], list[int]]] = {}
        for k, bias in enumerate(self.biases):
            own = [i for i, row in enumerate(self.names) if row in bias.rows]
            if bias.turn is None:
                shares[own, k] = [bias.rows[self.names[i]] for i in own]
            elif own:
                _, rows, places = turned.setdefault(bias.turn.platform, (bias.turn, own, [-1, -1, -1]))
                if rows != own:
                    raise ValueError(f"{bias.name}: rows {list(bias.rows)} are not allowed; as about the other axes")
                places[bias.turn.about] = k
        self.shares = shares
        self._turned = list(turned.values())

    def _split(self, state: Array) -> tuple[Array, Array]:
        return state[..., : self.states], state[..., self.states : self.states + len(self.biases)]

    def _vector(self, biases: Array, places: Sequence[int]) -> Array:
        """Return the rotation vector (..., 3) of a platform."""
        zero = np.zeros(biases.shape[:-1])
        return np.stack([zero if k < 0 else biases[..., k] for k in places], axis=-1)

    def _seen(self, target: Array, platforms: Array, biases: Array, i: int) -> tuple[Array, Array, Array | None]:
        """Return what is seen in turned axes, the rotation vector, and the axes."""
        turn, _, places = self._turned[i]
        vector, platform = self._vector(biases, places), platforms[..., turn.platform, :]
        body = None if turn.body is None else turn.body(platform)
        return seen_from_turned_axes(target, platform, rotation_matrix(vector), body, turn.axes), vector, body

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        compiled = program(self)
        if compiled is not None:
            return values(compiled, target, platforms)
        own, biases = self._split(target)
        value = self.model.predict(own, platforms)
        for i, (_, rows, _) in enumerate(self._turned):
            value = np.array(value)
            value[..., rows] = self.model.predict(self._seen(own, platforms, biases, i)[0], platforms)[..., rows]
        return value + np.einsum("ij,...j->...i", self.shares, biases)

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        return self.linearize(target, platforms)[1]

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        compiled = program(self)
        if compiled is not None:
            return linearized(compiled, target, platforms)
        own, biases = self._split(target)
        value, jacobian = self.model.linearize(own, platforms)
        value, whole = np.array(value), self._padded(jacobian, target)
        for i, (_, rows, _) in enumerate(self._turned):
            seen = self._seen(own, platforms, biases, i)[0]
            turned, by_seen = self.model.linearize(seen, platforms)
            value[..., rows] = turned[..., rows]
            whole[..., rows, :] = self._turned_back(by_seen, target, platforms, i)[..., rows, :]
        return value + np.einsum("ij,...j->...i", self.shares, biases), whole

    def _padded(self, jacobian: Array, state: Array) -> Array:
        """Return derivatives by the target's state with those by what is added behind; what else there is adds none."""
        n = self.states
        whole = np.zeros((*jacobian.shape[:-1], state.shape[-1]))
        whole[..., :n], whole[..., n : n + len(self.biases)] = jacobian, self.shares
        return whole

    def _turned_back(self, by_seen: Array, target: Array, platforms: Array, i: int) -> Array:
        """Return derivatives (..., m, n + k) from those by what is seen in turned axes (..., m, n)."""
        turn, _, places = self._turned[i]
        own, biases = self._split(target)
        _, vector, body = self._seen(own, platforms, biases, i)
        by_state, by_vector = turned_derivatives(own, platforms[..., turn.platform, :], vector, body, turn.axes)
        whole = self._padded(by_seen, target)
        for first in (0, turn.axes):
            if self.states >= first + turn.axes:
                part = slice(first, first + turn.axes)
                whole[..., part] = by_seen[..., part] @ by_state
        by_bias = by_seen @ by_vector
        for about, k in enumerate(places):
            if k >= 0:
                whole[..., self.states + k] += by_bias[..., about]
        return whole

    def equations(self) -> Equations | None:
        """See `MeasurementModel.equations`; None where the model has none, or a kernel mixes rows of both sorts."""
        inner = equations_of(self.model)
        return None if inner is None else biased_equations(inner, self.states, self.shares, self._turned)

    def modified_gain(self, measured: Array, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.modified_gain`.

        The model's own, for the measurement without what is added: exact in a bias that is added, and in a turn as the
        Jacobian is.
        """
        own, biases = self._split(target)
        clean = measured - np.einsum("ij,...j->...i", self.shares, biases)
        whole = self._padded(self.model.modified_gain(clean, own, platforms), target)
        for i, (_, rows, _) in enumerate(self._turned):
            seen = self._seen(own, platforms, biases, i)[0]
            gain = self.model.modified_gain(clean, seen, platforms)
            whole[..., rows, :] = self._turned_back(gain, target, platforms, i)[..., rows, :]
        return whole

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.model.noise_covariance()

    def noise_covariance_at(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.noise_covariance_at`."""
        return self.model.noise_covariance_at(self._split(target)[0], platforms)

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`."""
        return self.model.residual(measured, predicted)

    def represent(self, value: Array) -> Array:
        """See `MeasurementModel.represent`."""
        return self.model.represent(value)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """See `MeasurementModel.platforms_used`."""
        used = np.array(self.model.platforms_used(platforms))
        for turn, rows, _ in self._turned:
            used[rows, turn.platform] = True
        return used
