"""A receiver on a moving platform: I/Q samples of one emitter, with noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Clock
from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.geometry.visibility import Mask
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.iq.reception import delay_over, receive, straight, with_acceleration
from quietfix.systems.iq.waveform import Emission, positive_number
from quietfix.systems.noise import normal
from quietfix.systems.signals import EnsembleBlock
from quietfix.systems.trajectories.gravity import GravityConstants, acceleration

__all__ = ["Receiver"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class Receiver(EnsembleBlock):
    r"""Receive an emitter on one of the platforms.

    Inputs ``target``, ``platforms`` and ``emission`` (abstract), output ``iq`` (abstract, an `IqBlock`).

    At every tick t it outputs a block centred on t, so that what is measured on it holds for t. Signal
    :math:`g\,s(t-D(t))\,e^{-j 2\pi f_c D(t)}` plus white complex noise of variance :math:`|g|^2/\mathrm{SNR}`, a
    function of (seed, block name, trial, tick). **The SNR is that in the sample rate**: signal power over the power of
    the noise in all of it. Between ticks, in a trial whose platform is below the horizon, and where a state is not
    finite, the samples are NaN.

    Over a block the target moves on a straight line in Earth-fixed axes and the platform with the constant
    acceleration of gravity, both through their states at t. What that leaves for satellites in low orbit is the change
    of gravity, 10 mm/s^3: 1e-9 m at 8 ms and 5e-8 m at 33 ms from t, 1e-6 of a wavelength at 3 GHz. A target that
    manoeuvres with a is off by a t^2/2, 0.3 mm at 8 ms and 1 g, the same at both receivers but for their directions.

    Parameters
    ----------
    platform : int
        Index of the platform that carries it.
    clock : Clock
        When it samples.
    trials : int
        Trials of the noise.
    platforms : int
        Number of platforms on the port.
    sample_rate : float
        [Hz], > 0; complex samples.
    samples : int
        Samples of a block, >= 1.
    margin : int
        Samples more on both sides, for who shifts this block against another, >= 0.
    snr_db : float
        Signal to noise in the sample rate [dB]; ``inf`` is no noise.
    gain : complex
        Of the channel, not 0: scales signal and noise alike.
    constants : GravityConstants, optional
        Gravity that acts on the platform; None for a platform on a straight line in Earth-fixed axes.
    earth_rate : float
        Rotation of the Earth-fixed axes where `constants` is None [rad/s].
    target_trials, target_size, platform_trials : int
        Shapes of the ports; one trial of truth serves all trials of noise.
    mask : Mask, optional
        Who sees whom; by default every platform sees the target, even through the Earth.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        platform: int,
        clock: Clock,
        trials: int,
        platforms: int,
        sample_rate: float,
        samples: int,
        margin: int = 0,
        snr_db: float = math.inf,
        gain: complex = 1.0,
        constants: GravityConstants | None = None,
        earth_rate: float = EARTH_RATE,
        target_trials: int = 1,
        target_size: int = 6,
        platform_trials: int = 1,
        mask: Mask | None = None,
        name: str = "receiver",
    ) -> None:
        super().__init__(name)
        for what, count in (("target", target_trials), ("platforms", platform_trials)):
            if count not in (1, trials):
                raise ValueError(f"{name}: {what} has {count} trials; 1 or {trials} are allowed")
        if not 0 <= platform < platforms:
            raise ValueError(f"platform: {platform} is not allowed; 0 to {platforms - 1}")
        positive_number(sample_rate, "sample_rate", "Hz")
        for what, count, least in (("samples", samples, 1), ("margin", margin, 0)):
            if not (isinstance(count, int | np.integer) and count >= least):
                raise ValueError(f"{what}: {count!r} is not allowed; a whole number >= {least}")
        if math.isnan(snr_db) or snr_db == -math.inf:
            raise ValueError(f"snr_db: {snr_db} is not allowed; a number of dB, or inf for no noise")
        if not (np.isfinite(gain) and gain != 0):
            raise ValueError(f"gain: {gain} is not allowed; a finite number, not 0")
        self.clock, self.trials, self.sample_rate = clock, trials, float(sample_rate)
        self.samples, self.margin, self.size = int(samples), int(margin), int(samples + 2 * margin)
        self._platform, self._platforms = platform, platforms
        self._gain, self._sigma = complex(gain), abs(gain) * 10 ** (-snr_db / 20)
        self._constants, self._mask = constants, mask
        self._earth_rate = earth_rate if constants is None else constants.earth_rate
        self._offsets: Array = (np.arange(self.size, dtype=np.float64) - 0.5 * (self.size - 1)) / self.sample_rate
        self.declare_input("target", target_trials, target_size)
        self.declare_input("platforms", platform_trials, 6 * platforms)
        self.declare_abstract_input("emission", Emission)
        draw = self.declare_draw()
        given = {self.time_ticket(), *(self.input_ticket(port) for port in ("target", "platforms", "emission"))}
        self._clean = self.declare_cached("clean", Receiver._receive, given)
        self.declare_abstract_output("iq", self._samples, {self.cached_ticket(self._clean), draw})

    def _receive(self, context: Context) -> ComplexArray | None:
        """Return the samples without noise, (1 or trials, size); None between ticks."""
        time = context.get_time()
        if self.clock.index(time) is None:
            return None
        target = self.read(context, "target")[:, :6]
        platforms = self.read(context, "platforms").reshape(-1, self._platforms, 6)
        own = platforms[:, self._platform]
        heard = np.isfinite(target).all(axis=-1) & np.isfinite(own).all(axis=-1)
        if self._mask is not None:
            heard = heard & self._mask.visible(target, platforms)[..., self._platform]
        clean = np.full((heard.size, self.size), np.nan + 0j)
        if heard.any():
            target, own = (np.broadcast_to(state, (heard.size, 6))[heard] for state in (target, own))
            clean[heard] = self._hear(self.read_abstract(context, "emission"), time, target, own)
        return clean

    def _hear(self, emission: Emission, time: float, target: Array, own: Array) -> ComplexArray:
        if self._constants is None:
            receiver = straight(own, self._earth_rate)
        else:
            pull = acceleration(own[..., :3], self._constants, self._constants.j2 != 0)
            receiver = with_acceleration(own, pull, self._earth_rate)
        half = 0.5 * self.size / self.sample_rate
        delay = delay_over(straight(target, self._earth_rate), receiver, half)
        return receive(emission, delay, time, self._offsets)

    def _samples(self, context: Context) -> IqBlock:
        clean = self.cached(context, self._clean)
        time = context.get_time()
        carrier = self.read_abstract(context, "emission").carrier
        start = time + self._offsets[0]
        if clean is None:
            return IqBlock(np.full((self.trials, self.size), np.nan + 0j), self.sample_rate, carrier, start)
        tick = self.clock.index(time)
        assert tick is not None
        samples = self._gain * clean
        if self._sigma > 0:
            draw = self.draw(context)
            white = normal(draw.seed, self.noise_name(), draw.first_trial, self.trials, tick, 2 * self.size)
            white *= self._sigma / math.sqrt(2)
            samples = samples + white.view(complex)
        return IqBlock(np.broadcast_to(samples, (self.trials, self.size)), self.sample_rate, carrier, start)
