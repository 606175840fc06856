"""The scenario of `quietfix.diagrams.recorded.kiwisdr`: what ``--set KEY=VALUE`` changes."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.ambiguity.differences import Window
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.ambiguity.prefilter import Band
from quietfix.systems.documented import documented, number, text
from quietfix.systems.options.choice import EstimatorChoice
from quietfix.systems.options.iekf import Iekf

__all__ = ["Settings"]


@dataclass
class Settings:
    """How the receivers are compared, and what the estimator believes; each field says what it is."""

    data: str = text("folder of the recording; empty: the environment variable QUIETFIX_DATA names it", "")
    sample_rate_hz: float = number(
        "of the common base of time; the receivers' own are 12001.03 to 12001.09 Hz", 12000.0, above=0
    )
    carrier_hz: float = number("to which the receivers were tuned", 77500.0, above=0)
    integration_s: float = number("of one comparison, and the time to the next", 1.0, above=0)
    half_band_hz: float = number(
        "the transmitter's phase noise code (645.8 chips a second) lies within", 600.0, above=0
    )
    notch_hz: float = number(
        "half-width of the gap that takes the carrier away, which has no delay to tell", 2.0, at_least=0.0
    )
    half_delay_s: float = number("half of the window of the search; 2 ms is 600 km", 2e-3, above=0)
    half_frequency_hz: float = number("the same; clocks set by GPS differ by millihertz", 2.0, above=0)
    sigma_altitude_m: float = number(
        "of the ellipsoid's surface taken for the height of transmitter and receivers", 200.0, above=0
    )

    divergence_km: float = number("an error at the end beyond which an estimator is lost", 50.0, above=0)
    estimators: dict[str, EstimatorChoice] = documented(
        "the estimators and their options", factory=lambda: {"iekf": Iekf()}
    )

    @property
    def function(self) -> CrossAmbiguity:
        """How two receivers are compared."""
        band = Band(-self.half_band_hz, self.half_band_hz, self.notch_hz, known=False)
        return CrossAmbiguity(prefilter=band, follow_rate=False)

    @property
    def window(self) -> Window:
        """Where the peak is sought."""
        return Window(0.0, 0.0, self.half_delay_s, self.half_frequency_hz)
