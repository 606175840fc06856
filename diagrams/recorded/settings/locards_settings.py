"""The scenario of `quietfix.diagrams.recorded.locards`: what ``--set KEY=VALUE`` changes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from quietfix.diagrams.schema.errors import choose
from quietfix.systems.documented import count, documented, number, text
from quietfix.systems.options.choice import EstimatorChoice
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.registry import ESTIMATORS, object_at

__all__ = ["FALLBACK_M", "LEAST_M", "Settings"]

FALLBACK_M = 40.0
"""Standard deviation of a time difference where too few messages tell it, as a length."""
LEAST_M = 10.0
"""The least that is estimated: 33 ns. What one refractive index for all receivers, surveyed places and whole
nanoseconds leave open is some metres."""


@dataclass
class Settings:
    """What the estimators believe, and what is tried out; each field says what it is.

    A long silence begins a new track because after two minutes an airliner may be 30 km from its first fix, as far as
    receivers are from each other, and an undamped iteration no longer finds back from there. Barometric altitude and
    height above the ellipsoid differ by the weather and by the geoid: -100 to +220 m in the packaged sets.
    """

    data: str = text("folder of the recording; empty: the environment variable QUIETFIX_DATA names it", "")
    estimator: str = text(
        "short for two estimators of that name in the place of those below, one with the gate, one without it", ""
    )
    sigma_tdoa_m: float = number(
        "standard deviation of a time difference, as a length; 0: from the residuals of each set as a whole",
        0.0,
        at_least=0.0,
    )
    sigma_altitude_m: float = number(
        "of the barometric altitude, taken for the height above the ellipsoid", 150.0, above=0
    )
    assumed_altitude_m: float = number(
        "of a message that reports none: aircraft are between the ground and 13 km", 6500.0
    )
    sigma_assumed_altitude_m: float = number("its standard deviation: of a uniform distribution", 3750.0, above=0)
    acceleration_density_m2ps3: float = number("white-noise acceleration of the aircraft", 1.0, above=0)
    sigma_velocity_mps: float = number("of the velocity per axis at the start", 200.0, above=0)
    false_alarm: float = number(
        "probability that the gate's test fails for a sound message", 1e-3, above=0, at_most=0.5
    )
    gap_s: float = number("an aircraft that was silent for longer begins a new track", 120.0, above=0)
    air: bool = documented("correct for the refractive index of the air, 0.17 m per kilometre", True)
    fault_m: float = number(
        "what-if: a second trial hears the same messages with so large an error at one receiver of some of them; "
        "0: no such trial",
        0.0,
        at_least=0.0,
    )
    fault_share: float = number("which share of the messages it strikes", 0.2, at_least=0.0, at_most=1.0)
    seed: int = count("which messages and receivers it strikes", 0, at_least=0)
    divergence_km: float = number("an error at the end of a track beyond which it is lost", 20.0, above=0)
    without_gate: list[str] = documented(
        "estimators that get the messages as they are; the others get what the gate leaves of them",
        factory=lambda: ["iekf_no_gate"],
    )
    estimators: dict[str, EstimatorChoice] = documented(
        "the estimators and their options", factory=lambda: {"iekf": Iekf(), "iekf_no_gate": Iekf()}
    )

    @property
    def trials(self) -> int:
        """As recorded, and with faults."""
        return 2 if self.fault_m > 0 and self.fault_share > 0 else 1

    def completed(self) -> Settings:
        """Return the settings with the two estimators that `estimator` is short for."""
        if not self.estimator:
            return self
        make = object_at(ESTIMATORS[choose("estimator", self.estimator, ESTIMATORS)])
        bare = f"{self.estimator}_no_gate"
        return replace(self, estimator="", without_gate=[bare], estimators={self.estimator: make(), bare: make()})
