"""Start from one measurement: direction and height give the place, the delay sharpens it, the Doppler says a speed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.direction import BodyDirection
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation, take
from quietfix.systems.filters.square_root import Gains
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.fixes.ray_height import ray_at_height
from quietfix.systems.linear_algebra import cholesky
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.base import positive
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.starts.start import CloudStart

__all__ = ["DirectionStart"]

Array = NDArray[np.float64]

_HEIGHT = "assumed_height"
_NOISE = "start_noise_covariance"
_NOWHERE = 1e6  # m, standard deviation of a position before anything is known: a hundred times what a direction leaves
_INFLATION = 1.2  # of the proposal's covariance: it must have wider tails than what it stands for


class DirectionStart(CloudStart):
    r"""Belief given direction, delay and Doppler difference of one instant, an assumed height and a prior of velocity.

    `begin` solves for the maximum a posteriori by Gauss-Newton, from where the measured ray reaches the assumed height;
    its covariance is the inverse information. `cloud` draws from the same posterior without linearising it: azimuth,
    depression (or cosines) and height from a normal proposal around that solution, the place from where that ray
    reaches that height, the velocity *exactly* from its conditional given the place and the Doppler difference, which
    is linear and Gaussian in the velocity; each particle is weighted by

    .. math:: w \propto \frac{p(d \mid p)\,p(\tau \mid p)\,p(h)\,p(f \mid p)}{q(d, h)}, \qquad
              p(f \mid p) = N(f;\ f(p, 0),\ C P_v C^T + R_f)

    With light time a delay depends on the velocity, by 0.2 ns at 200 m/s: that is in `begin`, and left out of `cloud`.

    A proposal in position would waste nearly all particles (a delay of 20 ns is 80 m in a prior of kilometres).

    Parameters
    ----------
    direction : BodyDirection
        The direction model that the estimator believes in.
    delay : Tdoa
    doppler : Fdoa
        The difference models that it believes in.
    stream : sequence of str
        Names of the rows on the measurement port.
    sigma_height : float
        Standard deviation of the height that is assumed on the port ``assumed_height`` [m].
    sigma_velocity : float
        Standard deviation of the velocity per axis [m/s].
    noise_port : bool
        True where R comes with the measurement: the estimator then gets a port ``start_noise_covariance``, to be
        connected to the same output as its ``noise_covariance``.

    Raises
    ------
    ValueError
        If a row is not measured or a standard deviation is not positive.
    """

    uses_measurement = True

    def __init__(
        self,
        direction: BodyDirection,
        delay: Tdoa,
        doppler: Fdoa,
        stream: Sequence[str],
        sigma_height: float,
        sigma_velocity: float,
        noise_port: bool = False,
    ) -> None:
        self._direction, self._delay, self._doppler = direction, delay, doppler
        self._model = self.uses = Stack([direction, delay, doppler])
        absent = [row for row in self._model.names if row not in stream]
        if absent:
            raise ValueError(f"start: rows {absent} are not measured; there are {list(stream)}")
        self._rows = [list(stream).index(row) for row in self._model.names]
        self._width = len(stream)
        self._altitude = Altitude(positive(sigma_height, "sigma_height", "m"), _HEIGHT)
        self.sigma_velocity = positive(sigma_velocity, "sigma_velocity", "m/s")
        self._noise_port = noise_port
        self.noise_input = _NOISE if noise_port else None
        self.again = self

    @property
    def inputs(self) -> Mapping[str, int]:
        """See `Start`."""
        return {_HEIGHT: 1, **({_NOISE: self._width**2} if self._noise_port else {})}

    def _noise(self, inputs: Mapping[str, Array], trials: int) -> Array:
        if not self._noise_port:
            return np.broadcast_to(self._model.noise_covariance(), (trials, self._model.size, self._model.size))
        noise = inputs[_NOISE].reshape(trials, self._width, self._width)
        return noise[:, self._rows][:, :, self._rows]

    def _solve(
        self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]
    ) -> tuple[Array, Array, Array, Array]:
        """Return rows and noise covariance that are used, and mean and covariance of the maximum a posteriori."""
        trials = measurement.shape[0]
        rows, height = measurement[:, self._rows], inputs[_HEIGHT]
        noise = self._noise(inputs, trials)
        # a row without a variance is not there
        rows = np.where(np.isfinite(np.einsum("...ii->...i", noise)), rows, np.nan)
        direction = self._direction.unit_vector(rows[:, :2], platforms)
        origin = platforms[..., self._direction.platform, :3]
        place = ray_at_height(np.broadcast_to(origin, (trials, 3)), direction, height[:, 0])
        able = np.all(np.isfinite(place), axis=-1)
        mean, covariance = np.full((trials, 6), np.nan), np.full((trials, 6, 6), np.nan)
        if able.any():
            model = Stack([self._model, self._altitude])
            full = np.zeros((trials, model.size, model.size))
            full[:, :-1, :-1] = noise
            full[:, -1, -1] = self._altitude.sigma**2
            guess = np.concatenate([place[able], np.zeros((able.sum(), 3))], axis=-1)
            prior = np.broadcast_to(self._vague(), (len(guess), 6, 6))
            given = np.concatenate([rows, height], axis=-1)[able]
            observation = Observation(given, take(platforms, able), Whitener(full[able]))
            found = IteratedExtendedKalman(20, 1e-3).update(guess, prior, observation, model)
            mean[able], covariance[able] = found.mean, found.covariance
        return rows, noise, mean, covariance

    def _vague(self) -> Array:
        return np.diag([_NOWHERE**2] * 3 + [self.sigma_velocity**2] * 3)

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`; a trial without a direction cannot start yet."""
        return self._solve(measurement, platforms, inputs)[2:]

    def covariance_at(self, target: Array, platforms: Array) -> Array:
        """Return the inverse information of the start for a target at `target`, shape (..., 6, 6)."""
        model = Stack([self._model, self._altitude])
        rows = Whitener(model.noise_covariance()).matrix(None) @ model.jacobian(target, platforms)
        root = np.broadcast_to(np.sqrt(self._vague()), (*target.shape[:-1], 6, 6))
        return Gains(root, rows @ root).covariance()

    def cloud(
        self, measurement: Array, platforms: Array, inputs: Mapping[str, Array], white: Array
    ) -> tuple[Array, Array]:
        """See `CloudStart.cloud`."""
        rows, noise, mean, covariance = self._solve(measurement, platforms, inputs)
        able = np.all(np.isfinite(mean), axis=-1)
        particles, log_weight = np.full(white.shape, np.nan), np.full(white.shape[:-1], np.nan)
        if not able.any():
            return particles, log_weight
        able_platforms = take(platforms, able)
        particles[able], log_weight[able] = self._draw(
            rows[able], noise[able], mean[able], covariance[able], able_platforms, inputs[_HEIGHT][able], white[able]
        )
        return particles, log_weight

    def _draw(
        self,
        rows: Array,
        noise: Array,
        mean: Array,
        covariance: Array,
        platforms: Array,
        assumed: Array,
        white: Array,
    ) -> tuple[Array, Array]:
        """Draw the clouds of trials that have a solution."""
        coordinates = Stack([self._direction, self._altitude])
        centre, slope = coordinates.linearize(mean, platforms)
        slope = slope[..., :3]
        spread = _INFLATION * (slope @ covariance[:, :3, :3] @ np.swapaxes(slope, -1, -2))
        root = cholesky(spread)
        drawn = centre[:, None] + np.einsum("tij,tkj->tki", root, white[..., :3])
        wide = platforms[:, None]
        origin = np.broadcast_to(wide[..., self._direction.platform, :3], (*drawn.shape[:-1], 3))
        place = ray_at_height(origin, self._direction.unit_vector(drawn[..., :2], wide), drawn[..., 2])
        log_proposal = -0.5 * np.sum(white[..., :3] ** 2, axis=-1)

        at_rest = np.concatenate([place, np.zeros_like(place)], axis=-1)
        direction = self._direction.residual(rows[:, None, :2], drawn[..., :2])
        log_weight = _log_normal(direction, noise[:, :2, :2])
        log_weight += -0.5 * ((drawn[..., 2] - assumed) / self._altitude.sigma) ** 2
        delay = rows[:, None, 2:3] - self._delay.predict(at_rest, wide)
        log_weight += _log_normal(delay, noise[:, 2:3, 2:3])

        # v | p, f: one row, so that the gain is a vector; a Doppler difference that is missing leaves the prior
        value, jacobian = self._doppler.linearize(at_rest, wide)
        gradient = jacobian[..., 0, 3:6]
        surplus = rows[:, None, 3] - value[..., 0]
        there = np.isfinite(surplus)
        prior = self.sigma_velocity**2
        own = np.where(np.isfinite(noise[:, None, 3, 3]), noise[:, None, 3, 3], 1.0)
        total = prior * np.sum(gradient**2, axis=-1) + own
        log_weight += np.where(there, -0.5 * surplus**2 / total - 0.5 * np.log(total), 0.0)
        velocity = self.sigma_velocity * white[..., 3:]
        # Only along the gradient does the Doppler difference say anything: there the draw shrinks and moves.
        norm = np.sqrt(np.sum(gradient**2, axis=-1))
        unit = gradient / np.where(norm > 0, norm, 1.0)[..., None]
        along = np.sum(unit * velocity, axis=-1)
        gain = prior * norm / total
        moved = gain * np.where(there, surplus, 0.0) + np.sqrt(own / total) * along
        velocity += (np.where(there, moved, along) - along)[..., None] * unit
        log_weight = np.where(np.isfinite(log_weight), log_weight, -math.inf)
        place = np.where(np.isfinite(place), place, mean[:, None, :3])
        return np.concatenate([place, velocity], axis=-1), log_weight - log_proposal


def _log_normal(residual: Array, covariance: Array) -> Array:
    """Return -1/2 r' R^-1 r of residuals (trials, particles, m); a row without R or value is left out."""
    bad = ~np.isfinite(residual[:, 0]) | ~np.isfinite(np.einsum("...ii->...i", covariance))
    weight = Whitener(covariance).matrix(bad if bad.any() else None)
    whitened = np.einsum("tij,tkj->tki", weight, np.where(bad[:, None], 0.0, residual))
    return -0.5 * np.sum(whitened**2, axis=-1)
