"""The scenario of `quietfix.diagrams.recorded.kiwisdr`: what ``--set KEY=VALUE`` changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.ambiguity.differences import Window
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.ambiguity.prefilter import Band
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.documented import documented, number, text
from quietfix.systems.geometry.wave_path import WavePath
from quietfix.systems.options.choice import EstimatorChoice
from quietfix.systems.options.iekf import Iekf

__all__ = ["Settings"]

_ROUND = 250.0  # Hz
_PASSED = 0.42  # of the sample rate; up to 0.44 the interpolation is flat
_SPARE = 1e-3  # s; that a hop by the ionosphere may add


@dataclass
class Settings:
    """How the receivers are compared, and what the estimator believes; each field says what it is."""

    data: str = text("folder of the recording; empty: the environment variable QUIETFIX_DATA names it", "")
    platforms: str = text(
        "table of where the receivers stand (name, latitude_deg, longitude_deg, role); empty: stations.csv in the "
        "folder, platforms.csv, or gnss_pos/NAME.txt",
        "",
    )
    sample_rate_hz: float = number(
        "of the common base of time; 0: what all receivers have, rounded down to 250 Hz", 0.0, at_least=0.0
    )
    carrier_hz: float = number("to which the receivers were tuned; 0: the files' names tell", 0.0, at_least=0.0)
    integration_s: float = number("of one comparison, and the time to the next", 1.0, above=0)
    half_band_hz: float = number(
        "half of the band that is compared; 0: all that a receiver lets through (0.42 of its sample rate)",
        0.0,
        at_least=0.0,
    )
    notch_hz: float = number(
        "half-width of the gap that takes the carrier away, which has no delay to tell", 2.0, at_least=0.0
    )
    half_delay_s: float = number(
        "half of the window of the search; 0: what light needs between the receivers, and 1 ms", 0.0, at_least=0.0
    )
    half_frequency_hz: float = number("the same; clocks set by GPS differ by millihertz", 2.0, above=0)
    mirror_km: float = number(
        "height of the layer by which the wave is taken to go in one hop; 0: along the ground", 0.0, at_least=0.0
    )
    sigma_altitude_m: float = number(
        "of the ellipsoid's surface taken for the height of transmitter and receivers", 200.0, above=0
    )

    divergence_km: float = number("an error at the end beyond which an estimator is lost", 50.0, above=0)
    estimators: dict[str, EstimatorChoice] = documented(
        "the estimators and their options", factory=lambda: {"iekf": Iekf()}
    )

    @property
    def path(self) -> WavePath:
        """How the wave goes."""
        return WavePath(1e3 * self.mirror_km)

    def rate(self, receivers: Sequence[float]) -> float:
        """Return the sample rate of the common base [Hz], of the receivers' own."""
        return self.sample_rate_hz or _ROUND * math.floor(min(receivers) / _ROUND)

    def function(self, sample_rate: float) -> CrossAmbiguity:
        """Return how two receivers are compared."""
        half = self.half_band_hz or _PASSED * sample_rate
        return CrossAmbiguity(prefilter=Band(-half, half, self.notch_hz, known=False), follow_rate=False)

    def window(self, stations: NDArray[np.float64]) -> Window:
        """Return where the peak is sought for receivers at stations (p, 3)."""
        apart = np.linalg.norm(stations[:, None] - stations, axis=-1).max()
        return Window(0.0, 0.0, self.half_delay_s or apart / SPEED_OF_LIGHT + _SPARE, self.half_frequency_hz)
