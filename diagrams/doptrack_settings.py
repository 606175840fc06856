"""What ``quietfix replay doptrack --set KEY=VALUE`` changes."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from systems.documented import Allowed, count, documented, number

if TYPE_CHECKING:
    from diagrams.doptrack_data import Pass

__all__ = ["Selection", "Settings"]

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

    def takes(self, one: "Pass") -> bool:
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

    def refused(self) -> str:
        """Return what is wrong with lists as a whole; empty if nothing is."""
        for name in ("sigma_mps", "sigmas"):
            given = getattr(self, name)
            if len(given) != 3:
                return f"{name}: {given} is not allowed; {_POSITIVE.words}"
        return ""
