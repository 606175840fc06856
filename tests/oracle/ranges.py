"""Ranges, rates, differences and components in NumPy over leading axes: written apart from the kernels."""

import math

import numpy as np

from quietfix.systems.angles.direct_azimuth import DirectAzimuth
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import vertical
from quietfix.systems.geometry.light_time import arrival
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.component import Component
from quietfix.systems.measurement.distance import Range
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.frequency import Frequency
from quietfix.systems.measurement.position import Position
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.measurement.received_power import ReceivedPower
from quietfix.systems.measurement.sighted import SightedModel
from quietfix.systems.measurement.tdoa import GroundTdoa, Tdoa

_PER_NEPER = 10.0 / math.log(10.0)


class NumpyAltitude(Altitude):
    def predict(self, target, platforms):
        return vertical(target[..., :3])[1][..., None]

    def jacobian(self, target, platforms):
        return self.linearize(target, platforms)[1]

    def linearize(self, target, platforms):
        normal, height = vertical(target[..., :3])
        jacobian = np.zeros((*target.shape[:-1], 1, target.shape[-1]))
        jacobian[..., 0, :3] = normal
        return height[..., None], jacobian


class NumpyComponent(Component):
    def predict(self, target, platforms):
        return np.array(target[..., self.index : self.index + 1])

    def jacobian(self, target, platforms):
        rows = np.zeros((*target.shape[:-1], 1, target.shape[-1]))
        rows[..., 0, self.index] = 1.0
        return rows


class NumpyPosition(Position):
    def predict(self, target, platforms):
        return np.array(target[..., :3], dtype=float)

    def jacobian(self, target, platforms):
        jacobian = np.zeros((*target.shape[:-1], 3, target.shape[-1]))
        jacobian[..., :3] = np.eye(3)
        return jacobian


class NumpyDirectAzimuth(DirectAzimuth):
    def predict(self, target, platforms):
        return target[..., :1]

    def jacobian(self, target, platforms):
        jacobian = np.zeros((*target.shape[:-1], 1, target.shape[-1]))
        jacobian[..., 0, 0] = 1.0
        return jacobian


class NumpyRange(SightedModel, Range):
    def predict_from(self, sight, platforms):
        return sight.distance[..., self.stations]

    def linearize_from(self, sight, platforms, size):
        direction = sight.direction[..., self.stations, :]
        jacobian = np.zeros((*direction.shape[:-1], size))
        jacobian[..., :3] = direction
        return sight.distance[..., self.stations], jacobian


class NumpyReceivedPower(SightedModel, ReceivedPower):
    def predict_from(self, sight, platforms):
        return self.power - 10.0 * self.exponent * np.log10(sight.distance[..., self.stations])

    def linearize_from(self, sight, platforms, size):
        direction, distance = sight.direction[..., self.stations, :], sight.distance[..., self.stations]
        jacobian = np.zeros((*direction.shape[:-1], size))
        jacobian[..., :3] = -(_PER_NEPER * self.exponent) * direction / distance[..., None]
        return self.predict_from(sight, platforms), jacobian


class NumpyRangeRate(RangeRate):
    @property
    def _received(self):
        return self.stations

    def _geometry(self, target, platforms):
        """Return offset and velocity (3, rows, ...), distance and range rate (rows, ...).

        An unscented filter spends most of its time here. Axes and rows first: the innermost loop of every operation
        then runs over trials and sigma points, not over three axes or a handful of stations.
        """
        used = np.moveaxis(platforms[..., self._received, :], (-1, -2), (0, 1))
        state = np.ascontiguousarray(np.moveaxis(target[..., : 3 if self.at_rest else 6], -1, 0))[:, None]
        # broadcast from the right, as everywhere, behind the rows
        leading = max(state.ndim, used.ndim) - 2
        state, used = (
            part.reshape(*part.shape[:2], *(1,) * (leading - part.ndim + 2), *part.shape[2:]) for part in (state, used)
        )
        offset = state[:3] - used[:3]
        velocity = -used[3:] if self.at_rest else state[3:] - used[3:]
        distance = np.sqrt(_over_axes(offset * offset))
        return offset, velocity, distance, _over_axes(offset * velocity) / distance

    def _with_bias(self, rates, target):
        """Return the measurement (..., rows) for range rates (rows, ...)."""
        return np.moveaxis(rates if self.bias is None else rates + target[..., self.bias], 0, -1)

    def predict(self, target, platforms):
        return self._with_bias(self._geometry(target, platforms)[3], target)

    def jacobian(self, target, platforms):
        return self.linearize(target, platforms)[1]

    def linearize(self, target, platforms):
        offset, velocity, distance, rates = self._geometry(target, platforms)
        jacobian = np.zeros((*rates.shape[1:], len(rates), target.shape[-1]))
        rows_first = np.moveaxis(jacobian, -2, 0)
        for k in range(3):
            along = offset[k] / distance
            rows_first[..., k] = (velocity[k] - rates * along) / distance
            if not self.at_rest:
                rows_first[..., 3 + k] = along
        if self.bias is not None:
            jacobian[..., self.bias] = 1.0
        return self._with_bias(rates, target), jacobian


class NumpyFrequency(NumpyRangeRate, Frequency):
    def predict(self, target, platforms):
        return self.scale * super().predict(target, platforms)

    def linearize(self, target, platforms):
        value, jacobian = super().linearize(target, platforms)
        return self.scale * value, self.scale * jacobian


class NumpyDifferenced(SightedModel):
    @property
    def shares_sight(self):
        return not self.light_time

    @property
    def _picked(self):
        return self.receivers

    def _difference(self, values):
        return values[..., self._picked] - values[..., self.reference, None]

    def _difference_rows(self, gradients, size):
        jacobian = np.zeros((*gradients.shape[:-2], self.size, size))
        reference = gradients[..., self.reference, None, :]
        np.subtract(gradients[..., self._picked, :], reference, out=jacobian[..., : gradients.shape[-1]])
        return jacobian

    def predict_from(self, sight, platforms):
        return self._difference(self.values_from(sight))

    def linearize_from(self, sight, platforms, size):
        return self._difference(self.values_from(sight)), self._difference_rows(self.gradients_from(sight), size)

    def _wave(self, target, platforms):
        return arrival(target, platforms, self.reference, self.earth_rate, self.constants)

    def predict(self, target, platforms):
        if not self.light_time:
            return super().predict(target, platforms)
        return self._difference(self.values_of(self._wave(target, platforms)))

    def linearize(self, target, platforms):
        if not self.light_time:
            return super().linearize(target, platforms)
        wave = self._wave(target, platforms)
        rows = self._difference_rows(self.gradients_of(wave), target.shape[-1])
        return self._difference(self.values_of(wave)), rows


class NumpyTdoa(NumpyDifferenced, Tdoa):
    def values_from(self, sight):
        """Return the travel times [s]."""
        return sight.distance / SPEED_OF_LIGHT

    def gradients_from(self, sight):
        """Return u / c, shape (..., p, 3)."""
        return sight.direction / SPEED_OF_LIGHT

    def values_of(self, wave):
        """Return the delays [s]."""
        return wave.delay

    def gradients_of(self, wave):
        """Return their derivatives, shape (..., p, 6)."""
        return wave.delay_jacobian


class NumpyGroundTdoa(NumpyTdoa, GroundTdoa):
    def values_from(self, sight):
        """Return the travel times [s]."""
        return self.path.length(sight.distance) / SPEED_OF_LIGHT

    def gradients_from(self, sight):
        """Return their derivatives, shape (..., p, 3)."""
        return self.path.slope(sight.distance)[..., None] * sight.direction / SPEED_OF_LIGHT


class NumpyFdoa(NumpyDifferenced, Fdoa):
    def values_from(self, sight):
        """Return the Doppler shifts [Hz]."""
        return (-self._doppler / SPEED_OF_LIGHT) * sight.range_rate

    def gradients_from(self, sight):
        """Return the derivative with respect to position and velocity, shape (..., p, 6)."""
        both = np.concatenate([sight.range_rate_gradient, sight.direction], axis=-1)
        return (-self._doppler / SPEED_OF_LIGHT) * both

    def values_of(self, wave):
        """Return the Doppler shifts [Hz]."""
        return self._doppler * wave.frequency_ratio

    def gradients_of(self, wave):
        """Return their derivatives, shape (..., p, 6)."""
        return self._doppler * wave.frequency_ratio_jacobian


def _over_axes(parts):
    """Return the sum over the first of three axes, formed in place: no reduction that could depend on the others."""
    total = parts[0]
    total += parts[1]
    total += parts[2]
    return total
