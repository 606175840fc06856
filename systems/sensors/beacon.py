"""The stations of a rocket's beacon and transponder: range rates, with the mode of each station as an input."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Clock
from quietfix.systems.geometry.lines_of_sight import line_of_sight
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.measurement.range_rate import RangeRate, common_part
from quietfix.systems.noise import normal
from quietfix.systems.signals import EnsembleBlock, components_of

__all__ = ["BeaconStations"]

Array = NDArray[np.float64]


class BeaconStations(EnsembleBlock):
    r"""Range rates of one rocket at many stations.

    Inputs ``target``, ``platforms``, ``bias`` (the beacon's oscillator error [m/s]) and ``mode`` (per station; 0: it
    receives the beacon, range rate + bias; 1: it receives the transponder, range rate + uplink range rate). Outputs
    ``measurement``, and for scores ``common``: what most stations' measurements have in common at this instant [m/s].
    NaN between the ticks of the clock, at stations that do not see the rocket, and at transponder stations when the
    uplink station does not.

    .. math:: z_i = \dot r_i + \delta + \epsilon_i + w_i \ (\text{beacon}), \qquad
              z_i = \dot r_i + \dot r_{\mathrm{uplink}} + w_i \ (\text{transponder})

    Shang, Xing and Gan, Control Theory & Applications 29 (2012) 59.

    Parameters
    ----------
    model : RangeRate
        Rows and noise.
    clock : Clock
        When it samples.
    trials : int
        Trials of the measurement.
    platforms : int
        Number of stations.
    target_trials, target_size, bias_trials : int
        Shapes of the inputs; 1 or `trials`.
    uplink : int
        Station whose signal the transponder returns.
    sigma_residual : float
        Standard deviation of each station's own constant part of the beacon's bias, drawn per trial [m/s], >= 0.
    mask : ElevationMask, optional
        Without it every station sees the rocket, even through the Earth.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        model: RangeRate,
        clock: Clock,
        trials: int,
        platforms: int,
        target_trials: int = 1,
        target_size: int = 6,
        bias_trials: int = 1,
        uplink: int = 0,
        sigma_residual: float = 0.0,
        mask: ElevationMask | None = None,
        name: str = "stations",
    ) -> None:
        super().__init__(name)
        for what, count in (("target", target_trials), ("bias", bias_trials)):
            if count not in (1, trials):
                raise ValueError(f"{name}: {what} has {count} trials; 1 or {trials} are allowed")
        if not 0 <= uplink < platforms:
            raise ValueError(f"uplink station: {uplink} is not allowed; 0 to {platforms - 1}")
        if not (math.isfinite(sigma_residual) and sigma_residual >= 0):
            raise ValueError(f"sigma_station_residual: {sigma_residual} is not allowed; it must be >= 0 m/s")
        self.model = model
        self.clock = clock
        self.trials = trials
        self._platforms, self._uplink, self._mask = platforms, uplink, mask
        self._sigma_residual = sigma_residual
        self.declare_input("target", target_trials, target_size)
        self.declare_input("platforms", 1, 6 * platforms)
        self.declare_input("bias", bias_trials, 1)
        self.declare_input("mode", 1, platforms)
        inputs = {self.input_ticket(port) for port in ("target", "platforms", "bias", "mode")}
        parts = self.declare_cached("parts", BeaconStations._parts, inputs)
        self._cached_parts = parts
        draw = self.declare_draw()
        tickets = {self.time_ticket(), self.cached_ticket(parts), draw, *inputs}
        self.declare_output("measurement", trials, model.size, self._measure, tickets, components_of(model))
        common_trials = max(target_trials, bias_trials)
        self.declare_output("common", common_trials, 1, self._common, {self.cached_ticket(parts)})

    def _geometry(self, context: Context) -> tuple[Array, Array]:
        return self.read(context, "target"), self.read(context, "platforms").reshape(-1, self._platforms, 6)

    def _parts(self, context: Context) -> tuple[Array, Array]:
        """Return the range rates (1 or trials, p) and what is added to them (1 or trials, p)."""
        rates = line_of_sight(*self._geometry(context)).range_rate
        return rates, common_part(rates, self.read(context, "bias"), self.read(context, "mode"), self._uplink)

    def _common(self, context: Context) -> Array:
        return np.median(self.cached(context, self._cached_parts)[1], axis=-1, keepdims=True)

    def _measure(self, context: Context) -> Array:
        tick = self.clock.index(context.get_time())
        if tick is None:
            return np.full((self.trials, self.model.size), np.nan)
        rates, added = self.cached(context, self._cached_parts)
        beacon = self.read(context, "mode") < 0.5
        draw = self.draw(context)
        exact = rates + added
        if self._sigma_residual:
            white = normal(
                draw.seed, f"{self.noise_name()}:residual", draw.first_trial, self.trials, 0, self._platforms
            )
            exact = exact + np.where(beacon, self._sigma_residual * white, 0.0)
        if self._mask is not None:
            seen = self._mask.visible(*self._geometry(context))
            exact = np.where(seen & (beacon | seen[..., self._uplink, None]), exact, np.nan)
        white = normal(draw.seed, self.noise_name(), draw.first_trial, self.trials, tick, self.model.size)
        return exact[..., self.model.stations] + self.model.sigma * white
