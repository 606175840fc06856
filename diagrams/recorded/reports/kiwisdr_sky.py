r"""What the sky wave may do to a fix of KiwiSDR receivers, and what of it the delays show.

The windows of a recording share what the ionosphere adds to a receiver's delay, so the scatter between them does not
know of it. Between nothing and one hop by the layer of the day, :math:`e_i`, anything may be added; taken as
:math:`\mathrm{rms}\ e_i/\sqrt 3` it moves the fix by :math:`K B b` with K the gain of the least squares of the
differences, B their incidence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.diagrams.readers.kiwisdr.folder import KiwiData
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation
from quietfix.systems.geometry.wave_path import WavePath, hop_excess, mirror_height, sun_elevation
from quietfix.systems.measurement.tdoa import GroundTdoa

__all__ = ["SkyWave", "sky_wave"]

Array = NDArray[np.float64]

_TAIL = 1e-4  # chance of a chi-square beyond which chance is no explanation
_FAR = 200e3  # m; how far a wave goes along the ground above 2 MHz
_GROUND = 2e6  # Hz


@dataclass(frozen=True, eq=False)
class SkyWave:
    """What is known of it.

    Attributes
    ----------
    distance : ndarray, shape (p,)
        From the transmitter, where it is known, or the fix, to the receivers along the ground [m].
    mirror : ndarray, shape (p,)
        Height of the layer that reflects there [m].
    excess : ndarray, shape (p,)
        What a hop by it adds to the delay [s].
    day : bool or None
        Whether the Sun is up at all places of reflection, or at none; None: at some, or nobody knows when.
    off : ndarray, shape (p - 1,)
        Mean differences against the first receiver minus those of the wave from the transmitter, where it is known, or
        from the fix [s].
    sigma_off : ndarray, shape (p - 1,)
        What is believed of the means [s].
    cost : float
        Chi-square of `off`.
    freedom : int
        Its degrees of freedom: 0 where two differences give a fix and nothing is left over.
    covariance : ndarray, shape (2, 2)
        Of the fix, east and north [m^2], for what a sky wave adds.
    """

    distance: Array
    mirror: Array
    excess: Array
    day: bool | None
    off: Array
    sigma_off: Array
    cost: float
    freedom: int
    covariance: Array

    @property
    def uncovered(self) -> bool:
        """Whether the claimed sigmas cannot cover what the delays are off."""
        return bool(self.freedom and self.cost > chi2.isf(_TAIL, self.freedom))

    def notes(self, data: KiwiData, claimed: float, path: WavePath) -> list[str]:
        """Return it in words; `claimed`: one standard deviation of the fix as the estimator believes it [m]."""
        total = float(np.sqrt(np.trace(self.covariance) + claimed**2))
        when = {True: "by day", False: "by night", None: "by day or night"}[self.day]
        if self.uncovered:
            worst = int(np.argmax(np.abs(self.off / self.sigma_off)))
            off, sigmas = 1e6 * abs(self.off[worst]), abs(self.off[worst] / self.sigma_off[worst])
            lines = [
                f"the claimed {claimed / 1e3:.3g} km understates the error, by the sky wave or a clock: {off:.3g} us "
                f"({sigmas:.0f} sigma) of {data.names[worst + 1]} - {data.names[0]} are not those of a wave along the "
                f"{'sky' if path.mirror else 'ground'} from {data.transmitter or 'the fix'}"
            ]
        elif self.freedom:
            lines = ["the delays fit one another within what is claimed, but all windows share what a sky wave adds"]
        else:
            lines = ["sky wave: three receivers leave nothing over to show it in"]
        layers, added = _span(1e-3 * self.mirror, "km"), _span(1e6 * self.excess, "us")
        lines.append(
            f"a hop by the layer at {layers} ({when}) would add {added} to a delay; with that possible at any "
            f"receiver the fix is good to {total / 1e3:.3g} km (1 sigma)"
        )
        if data.frequency > _GROUND and not path.mirror and self.distance.max() > _FAR:
            lines.append(
                f"{1e-6 * data.frequency:.4g} MHz hardly go {self.distance.max() / 1e3:.0f} km along the ground; "
                f"--set mirror_km={1e-3 * self.mirror[0]:.0f} takes the wave to go by the ionosphere"
            )
        return lines


def _span(values: Array, unit: str) -> str:
    low, high = f"{values.min():.3g}", f"{values.max():.3g}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def sky_wave(data: KiwiData, position: Array, differences: Array, sigmas: Array, path: WavePath) -> SkyWave:
    """Return what is known of the sky wave.

    Parameters
    ----------
    data : KiwiData
    position : ndarray, shape (3,)
        The fix, Earth-fixed [m].
    differences, sigmas : ndarray, shape (p - 1,)
        Mean arrival times minus that at the first receiver [s], and their standard deviations; NaN: none.
    path : WavePath
        How the wave is taken to go.
    """
    known = bool(np.isfinite(data.mast).all())
    source = data.mast if known else position
    chord = np.linalg.norm(data.stations - source, axis=-1)
    mirror, day = _mirrors(data, source)
    excess = hop_excess(chord, mirror) / SPEED_OF_LIGHT
    model = GroundTdoa(1e-6, range(1, len(data.names)), path=path)
    state = np.concatenate([source, np.zeros(3)])
    there = np.isfinite(differences)
    off = differences - model.predict(state, data.still)
    weight = np.where(there, 1 / sigmas, 0.0)
    freedom = int(there.sum()) - (0 if known else 2)
    cost = float(np.nansum(np.square(off * weight)))
    gradient = model.jacobian(np.concatenate([position, np.zeros(3)]), data.still)[:, :3]
    level = gradient @ enu_rotation(*ecef_to_geodetic(position)[:2])[:2].T
    gain = np.linalg.pinv(level * weight[:, None]) * weight
    added = np.concatenate([-np.ones((there.size, 1)), np.eye(there.size)], axis=1) * (excess / np.sqrt(3))
    moved = gain @ added
    return SkyWave(chord, mirror, excess, day, off, sigmas, cost, max(freedom, 0), moved @ moved.T)


def _mirrors(data: KiwiData, source: Array) -> tuple[Array, bool | None]:
    """Return the height of the layer halfway to each receiver [m], and whether it is day there."""
    if np.isnan(data.posix):
        return np.full(len(data.names), mirror_height(data.frequency, False)), None
    latitude, longitude, _ = ecef_to_geodetic(0.5 * (data.stations + source))
    up = sun_elevation(latitude, longitude, data.posix) > 0
    heights = np.array([mirror_height(data.frequency, bool(one)) for one in up])
    return heights, bool(up[0]) if (up == up[0]).all() else None
