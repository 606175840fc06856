"""The scenario of `quietfix.diagrams.recorded.iq`: what ``--set KEY=VALUE`` changes."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.recorded.settings.position_settings import PositionSettings
from quietfix.systems.ambiguity.differences import Window
from quietfix.systems.ambiguity.prefilter import Band, Everything, Prefilter
from quietfix.systems.documented import choice, documented, number, text
from quietfix.systems.options.choice import EstimatorChoice

__all__ = ["Settings"]

_ALL = 1e12  # Hz; beyond any sample rate


@dataclass
class RawSettings:
    """What files without a header are."""

    rate_hz: float = number("sample rate; 0: there are no such files", 0.0, at_least=0.0)
    type: str = text("SigMF datatype of the samples", "ci16_le")
    frequency_mhz: float = number("to which the receivers were tuned", 0.0, at_least=0.0)


@dataclass
class Settings:
    """Integration time, window and band; each field says what it is."""

    integration_s: float = number(
        "integration time; 0: a sixteenth of what the recordings have in common, at most 0.1 s", 0.0, at_least=0.0
    )
    every_s: float = number("time from one comparison to the next; 0: the integration time", 0.0, at_least=0.0)
    delay_us: float = number("centre of the window in which the peak is sought", 0.0)
    half_delay_us: float = number("half of its width", 350.0, at_least=0.0)
    frequency_hz: float = number("centre of the window", 0.0)
    half_frequency_hz: float = number("half of its width", 1000.0, at_least=0.0)
    low_hz: float = number("lower edge of the band that is compared, from the tuned frequency", -_ALL)
    high_hz: float = number("its upper edge", _ALL)
    notch_hz: float = number("half-width of a gap at the tuned frequency: takes a carrier away", 0.0, at_least=0.0)
    confidence: float = number(
        "least chance that noise alone would not have made the peak; below, there is no measurement",
        0.99,
        at_least=0.0,
        at_most=1.0,
    )
    reference: str = text("receiver that the others are compared with; empty: the first")
    receivers: list[str] = documented("names of the receivers in the order of the files; empty: theirs", factory=list)
    platforms: str = text("where the receivers stand, a table: name, latitude_deg, longitude_deg, height_m", "")
    clocks: str = choice(
        "sample clocks. as_recorded: what they drift is said; corrected: and taken away, from the first sample on",
        "as_recorded",
        ("as_recorded", "corrected"),
    )
    position: PositionSettings = documented("what is assumed of the emitter", factory=PositionSettings)
    raw: RawSettings = documented("what files without a header are", factory=RawSettings)
    data: list[str] = documented("the recordings; each is compared with the reference", factory=list)
    estimators: dict[str, EstimatorChoice] = documented("none: nothing is estimated", factory=dict)

    @property
    def prefilter(self) -> Prefilter:
        """What both channels pass."""
        if self.low_hz <= -_ALL and self.high_hz >= _ALL and self.notch_hz == 0:
            return Everything()
        return Band(self.low_hz, self.high_hz, self.notch_hz, known=False)

    @property
    def window(self) -> Window:
        """Where the peak is sought."""
        return Window(1e-6 * self.delay_us, self.frequency_hz, 1e-6 * self.half_delay_us, self.half_frequency_hz)
