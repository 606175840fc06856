"""From the emitter's waveform to TDOA and FDOA: what two satellites that relay samples consist of.

Emitter, main and auxiliary receiver, inter-satellite link, direction finding and cross-ambiguity function are blocks;
the window in which the peak is sought comes from a track's prediction or from the direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.ambiguity.prefilter import Everything, Matched, Prefilter
from quietfix.systems.ambiguity.variance import exact
from quietfix.systems.angles.direction import BodyDirection
from quietfix.systems.clocks import Periodic
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.documented import choice, count, documented, number
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.geometry.visibility import Mask
from quietfix.systems.iq import modulation, pulse_train
from quietfix.systems.iq.bussgang import Quantiser
from quietfix.systems.iq.waveform import Waveform
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.sensors.joined import JoinedMeasurements, JoinedPart
from quietfix.systems.signal_chain.cross_ambiguity import QUALITY, CrossAmbiguitySensor
from quietfix.systems.signal_chain.inter_satellite_link import InterSatelliteLink
from quietfix.systems.signal_chain.receiver import Receiver
from quietfix.systems.signal_chain.search_window import SearchWindow
from quietfix.systems.signal_chain.transmitter import Transmitter
from quietfix.systems.signals import components_of

__all__ = [
    "QUALITY",
    "BandLimitedNoise",
    "Drawn",
    "PulseTrain",
    "Qpsk",
    "Signal",
    "SignalChain",
    "predicted_sigmas",
    "prefilter_of",
    "waveform_of",
]


_COARSE = "; more, as so few bits of the link take more from pulses, which stand above the mean, than from noise"
_LEAST_CELLS = 16  # a band of fewer frequency cells has no spectrum to speak of, nor a time difference
_SAMPLES_AT_ONCE = 2e6  # of one receiver in all trials: noise, sums and copies are some 200 bytes for each


@dataclass
class Drawn:
    """TDOA and FDOA are drawn, with the errors that `truth` states."""


@dataclass
class Qpsk:
    """Four-phase keying with root-raised-cosine pulses."""

    symbol_rate_mbd: float = number("symbol rate [MBd]", 2.0, above=0)
    roll_off: float = number("roll-off of the pulses", 0.25, above=0, at_most=1)


@dataclass
class BandLimitedNoise:
    """Gaussian noise with a flat spectrum."""

    band_mhz: float = number("width of the whole band [MHz]", 2.5, above=0)
    roll_off: float = number("share of the cosine edges", 0.25, above=0, at_most=1)


@dataclass
class PulseTrain:
    """Coherent linear-FM pulses; the FDOA is ambiguous by the pulse rate."""

    sweep_mhz: float = number("sweep within a pulse [MHz]", 2.0, above=0)
    width_us: float = number("length of a pulse [us]", 50.0, above=0)
    interval_ms: float = number("pulse repetition interval [ms]", 1.0, above=0)
    edge: float = number("share of the raised-cosine edges in a pulse", 0.1, at_least=0, at_most=1)


@dataclass
class Signal:
    """TDOA and FDOA come from I/Q samples by the cross-ambiguity function."""

    waveform: Qpsk | BandLimitedNoise | PulseTrain = documented(
        "what the emitter sends: !Qpsk, !BandLimitedNoise or !PulseTrain", factory=Qpsk
    )
    sample_rate_mhz: float = number("complex samples per second [MHz]", 4.0, above=0)
    samples: int = count("samples that are integrated at every epoch", 65536, at_least=1024, at_most=1 << 24)
    snr_main_db: float = number(
        "signal-to-noise ratio at the main satellite, noise counted in the whole sample rate [dB]",
        -12.0,
        at_least=-60,
        at_most=120,
    )
    snr_auxiliary_db: float = number("the same at the auxiliary satellite [dB]", -12.0, at_least=-60, at_most=120)
    gain_main: float = number("amplification of the main satellite's channel", 1.0, above=0)
    gain_auxiliary: float = number("the same of the auxiliary satellite's", 0.7, above=0)
    link_bits: int = count(
        "bits of I and of Q on the inter-satellite link; 0: not quantised", 8, at_least=0, at_most=24
    )
    link_full_scale: float = number(
        "what is beyond so many standard deviations of the samples is clipped", 4.0, above=0
    )
    link_delay_us: float = number("delay of the link, known to the main satellite [us]", 334.0)
    link_delay_error_ns: float = number("part of it that is not known: an error of the TDOA [ns]", 0.0)
    prefilter: str = choice(
        "matched: both channels pass a filter matched to the waveform; none: they do not",
        "matched",
        ("matched", "none"),
    )
    window: str = choice(
        "where the peak is sought. prediction: about the first estimator's prediction, and where there is none yet as "
        "direction; direction: about where the direction reaches an assumed height, at rest",
        "prediction",
        ("prediction", "direction"),
    )
    window_sigmas: float = number("half of the window in standard deviations of what is expected", 5.0, above=0)
    window_least_us: float = number("least half-width in delay [us]", 2.0, above=0)
    window_least_hz: float = number("least half-width in frequency [Hz]", 150.0, above=0)
    window_largest_hz: float | None = number(
        "largest half-width in frequency [Hz]; null: none. A pulse train needs one below half of its pulse rate",
        None,
        above=0,
    )
    window_height_km: float = number("height that is assumed with a direction [km]", 10.0, above=-1, at_most=500)
    window_sigma_height_km: float = number("its standard deviation [km]", 3.0, above=0)
    window_sigma_velocity_mps: float = number("standard deviation of the velocity per axis [m/s]", 200.0, above=0)
    confidence: float = number(
        "a peak is good if noise alone stays below it with this probability", 0.99, above=0, at_most=0.999999
    )
    gate: bool = documented("whether what is not good is a missing measurement; false: all is passed on", True)


def waveform_of(signal: Signal) -> Waveform:
    """Return the waveform of a scenario.

    Raises
    ------
    UserError
        If its band is wider than the sample rate, or narrower than some cells of frequency.
    """
    waveform = _waveform(signal.waveform)
    if signal.sample_rate_mhz * 1e6 < waveform.bandwidth:
        raise UserError(
            f"sensing.sample_rate_mhz: {signal.sample_rate_mhz:g} is not allowed; at least the waveform's band, "
            f"{waveform.bandwidth / 1e6:g} MHz"
        )
    least = _LEAST_CELLS * signal.sample_rate_mhz / signal.samples
    if waveform.bandwidth / 1e6 < least:
        raise UserError(
            f"sensing.waveform: a band of {waveform.bandwidth / 1e6:g} MHz is not allowed; at least {least:.4g} MHz, "
            f"{_LEAST_CELLS} times what {signal.samples} samples resolve"
        )
    return waveform


def _waveform(given: Qpsk | BandLimitedNoise | PulseTrain) -> Waveform:
    if isinstance(given, Qpsk):
        return modulation.Qpsk(given.symbol_rate_mbd * 1e6, given.roll_off)
    if isinstance(given, BandLimitedNoise):
        return modulation.BandLimitedNoise(given.band_mhz * 1e6, given.roll_off)
    return pulse_train.PulseTrain(given.sweep_mhz * 1e6, given.width_us * 1e-6, given.interval_ms * 1e-3, given.edge)


def prefilter_of(signal: Signal) -> Prefilter:
    """Return the prefilter of a scenario."""
    return Matched(waveform_of(signal)) if signal.prefilter == "matched" else Everything()


def predicted_sigmas(signal: Signal) -> tuple[float, float]:
    """Return the standard deviations of TDOA [s] and FDOA [Hz] to first order in the noise and what the link distorts.

    They are what bounds are computed with; the estimators get those that the samples of every epoch show. What the link
    distorts is that of a stationary Gaussian signal, see `quietfix.systems.ambiguity.variance`.
    """
    rate = signal.sample_rate_mhz * 1e6
    matched = Matched(waveform_of(signal))
    moments = matched.moments(rate)
    if signal.prefilter == "none":
        moments = type(moments)(moments.frequency, moments.step, np.ones_like(moments.weight), moments.spectrum)
    snr = [10 ** (decibels / 10) for decibels in (signal.snr_main_db, signal.snr_auxiliary_db)]
    link = Quantiser(signal.link_bits, signal.link_full_scale) if signal.link_bits else None
    sigmas = exact(moments, rate, signal.samples / rate, snr[0], snr[1], (None, link))
    return float(sigmas.delay), float(sigmas.frequency)


def _longest_baseline(orbit: DenseOrbit, duration: float, earth_rate: float) -> float:
    """Return the largest distance of the two satellites [m], with a per mille to spare."""
    times = np.linspace(0.0, duration, 31)
    places = inertial_to_earth_fixed(orbit.at(times), times[:, None], earth_rate)[..., :3]
    return 1.001 * float(np.linalg.norm(places[:, 1] - places[:, 0], axis=-1).max())


@dataclass(frozen=True)
class SignalChain:
    """Waveform, receivers, link, search window and cross-ambiguity function; publishes ``measured``.

    It takes ``target``, ``platforms`` and ``direction_finding``, and publishes ``noise_covariance``, ``quality`` (see
    `QUALITY`) and ``differences_covariance``, what the cross-ambiguity function says of its own errors. Unless the
    window comes from the direction, the first estimator's prediction is fed back.

    Attributes
    ----------
    signal : Signal
        The scenario's part.
    direction, tdoa, fdoa : BodyDirection, Tdoa, Fdoa
        As the estimators believe them to be measured.
    orbit : DenseOrbit
        The main and the auxiliary satellite.
    duration : float
        Of the run [s].
    clock : Periodic
        When samples are taken.
    mask : Mask
        Who sees whom.
    """

    signal: Signal
    direction: BodyDirection
    tdoa: Tdoa
    fdoa: Fdoa
    orbit: DenseOrbit
    duration: float
    clock: Periodic
    mask: Mask

    def __post_init__(self) -> None:
        """Check the arguments."""
        largest, least = self.signal.window_largest_hz, self.signal.window_least_hz
        if largest is not None and largest < least:
            raise UserError(
                f"sensing.window_largest_hz: {largest:g} is not allowed; at least window_least_hz, {least:g}"
            )

    @property
    def widest(self) -> int:
        """Most trials at once, for the memory that samples take."""
        return max(1, int(_SAMPLES_AT_ONCE / self.signal.samples))

    @property
    def note(self) -> str:
        """Signal-to-noise ratios with the bandwidth that they hold in, and what they leave."""
        return _note(self.signal)

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        longest = _longest_baseline(self.orbit, self.duration, self.orbit.constants.earth_rate) / SPEED_OF_LIGHT
        self._receive(bus, longest)
        signal = self.signal
        fed_back = ("prediction", "prediction_covariance") if signal.window == "prediction" else ()
        bus.add(
            self._window(bus.trials, longest),
            gives={"window": "window"},
            takes={"direction": "direction_finding"},
            feedback={port: port for port in fed_back},
        )
        # samples of one or two bits are all or often at their largest value: that is no saturated receiver
        coarse = 0 < signal.link_bits <= 2
        function = CrossAmbiguity(signal.samples, prefilter_of(signal), signal.confidence, 1.0 if coarse else 0.02)
        ambiguity = bus.add(
            CrossAmbiguitySensor(function, None, self.clock, bus.trials, keep_flagged=not signal.gate),
            gives={"quality": "quality", "differences_covariance": "noise_covariance"},
            takes={"main": "main_receiver.iq", "auxiliary": "inter_satellite_link.iq"},
        ).get_name()
        differences = [*components_of(self.tdoa), *components_of(self.fdoa)]
        parts = {
            "direction": JoinedPart(2, self.direction.noise_covariance(), components_of(self.direction)),
            "differences": JoinedPart(2, components=differences),
        }
        bus.add(
            JoinedMeasurements(parts, bus.trials),
            gives={"measured": "measurement", "noise_covariance": "noise_covariance"},
            takes={
                "direction": "direction_finding",
                "differences": f"{ambiguity}.measurement",
                "differences_noise_covariance": "differences_covariance",
            },
        )

    def _receive(self, bus: Bus, longest: float) -> None:
        signal, rate = self.signal, self.signal.sample_rate_mhz * 1e6
        bus.add(Transmitter(waveform_of(signal), self.fdoa.carrier), gives={"emission": "emission"})
        trials, size = bus.shape("target")
        for platform, (name, snr, gain) in enumerate(
            (
                ("main_receiver", signal.snr_main_db, signal.gain_main),
                ("auxiliary_receiver", signal.snr_auxiliary_db, signal.gain_auxiliary),
            )
        ):
            receiver = Receiver(
                platform,
                self.clock,
                bus.trials,
                2,
                rate,
                signal.samples,
                # the auxiliary satellite relays more on both sides, so that all delays find their samples
                platform * math.ceil(longest * rate),
                snr,
                gain,
                self.orbit.constants,
                target_trials=trials,
                target_size=size,
                mask=self.mask,
                name=name,
            )
            bus.add(receiver)
        delay = signal.link_delay_us * 1e-6
        link = InterSatelliteLink(
            delay + signal.link_delay_error_ns * 1e-9,
            delay,
            signal.link_bits or None,
            signal.link_full_scale,
            name="inter_satellite_link",
        )
        bus.add(link, takes={"iq": "auxiliary_receiver.iq"})

    def _window(self, trials: int, longest: float) -> SearchWindow:
        signal = self.signal
        return SearchWindow(
            self.direction,
            self.tdoa,
            self.fdoa,
            trials,
            2,
            signal.window_least_us * 1e-6,
            signal.window_least_hz,
            signal.window_sigmas,
            signal.window_height_km * 1e3,
            signal.window_sigma_height_km * 1e3,
            signal.window_sigma_velocity_mps,
            max(longest, signal.window_least_us * 1e-6),
            signal.window_largest_hz or math.inf,
            signal.window == "prediction",
        )


def _note(signal: Signal) -> str:
    delay, frequency = predicted_sigmas(signal)
    return (
        f"SNR {signal.snr_main_db:g} and {signal.snr_auxiliary_db:g} dB in the sample rate of "
        f"{signal.sample_rate_mhz:g} MHz leave {1e9 * delay:.3g} ns of TDOA and {frequency:.3g} Hz of FDOA above the "
        "threshold" + (_COARSE if 0 < signal.link_bits < 4 and isinstance(signal.waveform, PulseTrain) else "")
    )
