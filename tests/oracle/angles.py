"""Angles in NumPy over leading axes: written apart from the kernels."""

import numpy as np

from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.angles.direction import Direction, DirectionCosines
from quietfix.systems.angles.horizon import HorizonBearing
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.angles.relative_kinematics import RelativeKinematics
from quietfix.systems.geometry.body_frame import body_frame
from quietfix.systems.measurement.sighted import SightedModel
from quietfix.systems.trajectories.gravity import acceleration, gradient


class NumpyBearing(Bearing):
    def predict(self, target, platforms):
        return self._angles(self._offset(target, platforms))

    def _angles(self, offset):
        x, y = offset[..., 0], offset[..., 1]
        angles = np.empty((*x.shape, self.size))
        angles[..., 0] = np.arctan2(y, x)
        if self.size == 2:
            angles[..., 1] = np.arctan2(offset[..., 2], np.hypot(x, y))
        under = (x == 0) & (y == 0)
        if under.any():
            angles[under, 0] = np.nan
        return angles

    def jacobian(self, target, platforms):
        return self._gradient(self._offset(target, platforms), target.shape[-1])

    def _gradient(self, offset, size):
        x, y = offset[..., 0], offset[..., 1]
        square = x * x + y * y
        rows = np.zeros((*x.shape, self.size, size))
        with np.errstate(divide="ignore", invalid="ignore"):
            rows[..., 0, 0] = -y / square
            rows[..., 0, 1] = x / square
            if self.size == 2:
                z, ground = offset[..., 2], np.sqrt(square)
                slant = square + z * z
                rows[..., 1, 0] = -x * z / (ground * slant)
                rows[..., 1, 1] = -y * z / (ground * slant)
                rows[..., 1, 2] = ground / slant
        return rows

    def linearize(self, target, platforms):
        offset = self._offset(target, platforms)
        return self._angles(offset), self._gradient(offset, target.shape[-1])


class NumpyHorizonBearing(NumpyBearing, HorizonBearing):
    def predict(self, target, platforms):
        return self._angles(self._turned(target, platforms)[0])

    def jacobian(self, target, platforms):
        return self.linearize(target, platforms)[1]

    def linearize(self, target, platforms):
        offset, rotation = self._turned(target, platforms)
        jacobian = np.zeros((*offset.shape[:-1], self.size, target.shape[-1]))
        jacobian[..., :3] = self._gradient(offset, 3) @ rotation
        return self._angles(offset), jacobian


class NumpyRelativeKinematics(RelativeKinematics):
    @property
    def _accelerated(self):
        return "radial_acceleration" in self.names

    def predict(self, target, platforms):
        return self._all(target, platforms, False)[0][..., self._rows]

    def jacobian(self, target, platforms):
        return self.linearize(target, platforms)[1]

    def linearize(self, target, platforms):
        value, jacobian = self._all(target, platforms, True)
        return value[..., self._rows], jacobian[..., self._rows, :]

    def _all(self, target, platforms, derivative):
        observer = platforms[..., self.observer, :]
        offset = target[..., :6] - observer
        x, w = offset[..., :3], offset[..., 3:]
        level2 = x[..., 0] ** 2 + x[..., 1] ** 2
        level = np.sqrt(level2)
        r = np.sqrt(level2 + x[..., 2] ** 2)
        ce, se = level / r, x[..., 2] / r
        cb, sb = x[..., 0] / level, x[..., 1] / level
        radial = x / r[..., None]
        zero = np.zeros_like(r)
        azimuthal = np.stack([-sb, cb, zero], axis=-1)
        elevational = np.stack([-cb * se, -sb * se, ce], axis=-1)

        def dot(a, b):
            return np.einsum("...i,...i->...", a, b)

        value = np.empty((*r.shape, 6))
        value[..., 0] = np.arctan2(x[..., 1], x[..., 0])
        value[..., 1] = np.arctan2(x[..., 2], level)
        value[..., 2] = azimuth_rate = dot(azimuthal, w) / level
        value[..., 3] = elevation_rate = dot(elevational, w) / r
        value[..., 4] = speed = dot(radial, w)
        across = dot(w, w) - speed**2
        if self._accelerated:
            relative = acceleration(target[..., :3], self.constants, self.j2) - acceleration(
                observer[..., :3], self.constants, self.j2
            )
            value[..., 5] = dot(radial, relative) + across / r
        else:
            value[..., 5] = np.nan
        if not derivative:
            return value, value

        jacobian = np.zeros((*r.shape, 6, target.shape[-1]))
        by_level, by_range = azimuthal / level[..., None], elevational / r[..., None]
        jacobian[..., 0, :3] = jacobian[..., 2, 3:6] = by_level
        jacobian[..., 1, :3] = jacobian[..., 3, 3:6] = by_range
        # The derivative of grad(beta) . w with respect to the position is the rate of grad(beta) along w.
        spread = (speed * ce - r * se * elevation_rate)[..., None]
        outward = np.stack([cb, sb, zero], axis=-1)
        jacobian[..., 2, :3] = -(azimuth_rate[..., None] * outward + spread * by_level) / level[..., None]
        turning = elevation_rate[..., None] * radial + (azimuth_rate * se)[..., None] * azimuthal
        jacobian[..., 3, :3] = -(turning + speed[..., None] * by_range) / r[..., None]
        tangent = (w - speed[..., None] * radial) / r[..., None]
        jacobian[..., 4, :3] = tangent
        jacobian[..., 4, 3:6] = radial
        if self._accelerated:
            pull = np.einsum("...ij,...j->...i", gradient(target[..., :3], self.constants, self.j2), radial)
            side = (relative - dot(radial, relative)[..., None] * radial) / r[..., None]
            jacobian[..., 5, :3] = (
                pull + side - (across / r**2)[..., None] * radial - 2 * (speed / r)[..., None] * tangent
            )
            jacobian[..., 5, 3:6] = 2 * tangent
        return value, jacobian


class NumpyBodyDirection(SightedModel):
    def _body(self, sight, platforms):
        """Return the body frame (..., 3, 3) and the components (...) in it of the unit vector to the target."""
        frame, u = body_frame(platforms, self.platform, self.earth_rate), sight.direction[..., self.platform, :]
        # Written out: for a cloud of particles it is several times faster than einsum over axes of three.
        x, y, z = u[..., 0], u[..., 1], u[..., 2]
        ahead, right, down = (frame[..., i, 0] * x + frame[..., i, 1] * y + frame[..., i, 2] * z for i in range(3))
        return frame, (ahead, right, down)


class NumpyDirection(NumpyBodyDirection, Direction):
    def _angles(self, body):
        x, y, z = body
        ground = np.sqrt(x * x + y * y)
        angles = np.empty((2, *x.shape))
        # Arctangents of one argument take half the time of those of two. That of the azimuth is put into its half
        # plane afterwards; x + 0.0 is never -0.0, and 0/0, straight below, gives NaN.
        with np.errstate(divide="ignore", invalid="ignore"):
            np.arctan(y / (x + 0.0), out=angles[0, ...])
            np.arctan(z / ground, out=angles[1, ...])
        behind = x < 0
        if behind.any():
            angles[0, ...] += np.where(behind, np.copysign(np.pi, y), 0.0)
        return np.moveaxis(angles, 0, -1)

    def predict_from(self, sight, platforms):
        return self._angles(self._body(sight, platforms)[1])

    def linearize_from(self, sight, platforms, size):
        frame, body = self._body(sight, platforms)
        x, y, z = (component[..., None] for component in body)
        distance = sight.distance[..., self.platform, None]
        square = x * x + y * y
        ground = np.sqrt(square)
        ex, ey, ez = (frame[..., i, :] for i in range(3))
        jacobian = np.zeros((*body[0].shape, 2, size))
        with np.errstate(divide="ignore", invalid="ignore"):
            jacobian[..., 0, :3] = (x * ey - y * ex) / (square * distance)
            jacobian[..., 1, :3] = (ground * ez - (z / ground) * (x * ex + y * ey)) / distance
        return self._angles(body), jacobian


class NumpyDirectionCosines(NumpyBodyDirection, DirectionCosines):
    def predict_from(self, sight, platforms):
        return np.stack(self._body(sight, platforms)[1][:2], axis=-1)

    def linearize_from(self, sight, platforms, size):
        frame, body = self._body(sight, platforms)
        cosines, u = np.stack(body[:2], axis=-1), sight.direction[..., self.platform, None, :]
        jacobian = np.zeros((*cosines.shape, size))
        distance = sight.distance[..., self.platform, None, None]
        jacobian[..., :3] = (frame[..., :2, :] - cosines[..., None] * u) / distance
        return cosines, jacobian


class NumpyInterferometerPhase(SightedModel, InterferometerPhase):
    def predict_from(self, sight, platforms):
        return np.einsum("...mi,...i->...m", self.body_axes(platforms), sight.direction[..., self.platform, :])

    def linearize_from(self, sight, platforms, size):
        axes, u = self.body_axes(platforms), sight.direction[..., self.platform, :]
        phase = np.einsum("...mi,...i->...m", axes, u)
        rows = axes - phase[..., None] * u[..., None, :]
        jacobian = np.zeros((*phase.shape, size))
        jacobian[..., :3] = rows / sight.distance[..., self.platform, None, None]
        return phase, jacobian
