"""The scenario of `quietfix.diagrams.recorded.doptrack`: what ``--set KEY=VALUE`` changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from quietfix.systems.documented import Allowed, count, documented, number, text
from quietfix.systems.options.choice import EstimatorChoice
from quietfix.systems.options.iekf import Iekf

if TYPE_CHECKING:
    from quietfix.diagrams.readers.doptrack_data import Pass
__all__ = ["ORDERS", "Selection", "Settings"]

ORDERS = {"bias": 1, "bias_drift": 2, "bias_drift_rate": 3}
"""The estimators of the scenario: how many states their oscillators have."""

_POSITIVE = Allowed(lambda v: v > 0, "three numbers > 0")  # of each item


@dataclass
class Selection:
    """Which passes are used; nothing here needs to know the answer."""

    elevation_deg: float = number(
        "least predicted largest elevation: low passes see the satellite through a lot of air, and fix little", 15.0
    )
    span_s: float = number("least time from first to last sample", 300.0, at_least=0.0)
    samples: int = count("least number of samples", 300)
    always: list[str] = documented("passes that are used in any case", factory=list)

    def takes(self, one: Pass) -> bool:
        """Return whether a pass is used."""
        return one.name in self.always or (
            one.predicted_elevation >= self.elevation_deg
            and one.times[-1] - one.times[0] >= self.span_s
            and one.times.size >= self.samples
        )


@dataclass
class Settings:
    """What the estimators believe, and what they start from; each field says what it is.

    What the elements leave of the satellite's motion changes slowly, so samples closer to each other than `every_s` say
    the same again. A first look at residuals found 205, 13 and 8 m/s for the three `sigma_mps`.
    """

    data: str = text("folder of the recording; empty: the environment variable QUIETFIX_DATA names it", "")
    selection: Selection = documented("which passes are used", factory=Selection)
    every_s: float = number("time between the samples that are used", 20.0, above=0)
    sigma_mps: list[float] = documented(
        "standard deviation of a range rate for bias only, with drift, with drift rate: what the elements and that "
        "oscillator leave of it",
        factory=lambda: [200.0, 15.0, 10.0],
        allowed=_POSITIVE,
    )
    freedom: float = number("degrees of freedom of its t distribution", 4.0, above=0)
    sigma_altitude_m: float = number("of the known altitude of the station", 100.0, above=0)
    sigmas: list[float] = documented(
        "standard deviation at the start of a pass of bias [m/s], drift [m/s^2], drift rate [m/s^3]",
        factory=lambda: [2000.0, 3.0, 0.01],
        allowed=_POSITIVE,
    )
    offset_km: float = number("how far off the start is", 200.0, above=0, at_most=5000.0)
    offset_course_deg: float = number("and where to", 45.0)
    pause_s: float = number("after such a pause it is another pass", 1200.0, above=0)
    oscillator_states: dict[str, int] = documented(
        "how many states the oscillator has, by estimator: 1, its bias; 2, and drift; 3, and drift rate; 2 where "
        "nothing is said",
        factory=lambda: dict(ORDERS),
    )
    divergence_km: float = number("a horizontal error at the end beyond which an estimator is lost", 100.0, above=0)
    estimators: dict[str, EstimatorChoice] = documented(
        "the estimators and their options", factory=lambda: {name: Iekf() for name in ORDERS}
    )

    def order(self, name: str) -> int:
        """Return how many states the oscillator of an estimator has."""
        return self.oscillator_states.get(name, 2)

    def refused(self) -> str:
        """Return what is wrong with lists and mappings as a whole; empty if nothing is."""
        for name in ("sigma_mps", "sigmas"):
            given = getattr(self, name)
            if len(given) != 3:
                return f"{name}: {given} is not allowed; {_POSITIVE.words}"
        for name, order in self.oscillator_states.items():
            if order not in (1, 2, 3):
                return f"oscillator_states.{name}: {order} is not allowed; 1, 2 or 3"
        return ""
