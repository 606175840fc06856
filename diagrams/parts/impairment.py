"""Parts that impair what is measured and known: errors that no estimator knows of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.parts.sensor_errors import SensorErrors
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Clock
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.gauss_markov import GaussMarkov
from quietfix.systems.plants.model_plant import ModelPlant
from quietfix.systems.sensors.attitude_error import AttitudeError
from quietfix.systems.sensors.navigation import Navigation
from quietfix.systems.sensors.platform_error import PlatformError
from quietfix.systems.sensors.reading_error import ReadingError

__all__ = ["Impaired", "KnownPlatforms", "Mount", "NavigationError"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mount:
    """Which directions a platform measures, and in what axes.

    Attributes
    ----------
    rows : sequence of str
        Rows of the sensor that are directions or their rates.
    platform : int
        Which platform carries it.
    body : callable, optional
        See `AttitudeError`.
    """

    rows: Sequence[str]
    platform: int = 0
    body: Callable[[Array], Array] | None = None


@dataclass(frozen=True)
class Impaired:
    """Put the errors that are on behind a signal; publishes it with them, as ``measurement`` too by default.

    With all of them off nothing is added.

    Attributes
    ----------
    model : MeasurementModel
        What was measured.
    clock : Clock
        When.
    errors : SensorErrors
    mounts : sequence of Mount
        Who measures directions.
    clocks : mapping of str to (int, int)
        Rows that compare two receivers' times of arrival [s]: the receiver and the reference.
    axes : int
        Space dimensions of the target's state.
    takes : str
        The signal.
    gives : sequence of str
        What it is called behind the errors.
    prefix : str
        Of the blocks' names, which key their noise.
    """

    model: MeasurementModel
    clock: Clock
    errors: SensorErrors
    mounts: Sequence[Mount] = ()
    clocks: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    axes: int = 3
    takes: str = "measured"
    gives: Sequence[str] = ("raw", "measurement")
    prefix: str = ""

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        signal = self._misread(bus, self._turn(bus, self.takes))
        bus.publish(**dict.fromkeys(self.gives, bus[signal]))

    def _turn(self, bus: Bus, signal: str) -> str:
        errors = self.errors
        bias = np.radians([errors.attitude_roll_deg, errors.attitude_pitch_deg, errors.attitude_yaw_deg])
        if not (np.any(bias) or errors.sigma_attitude_deg):
            return signal
        target, (platform_trials, numbers) = bus.shape("target"), bus.shape("platforms")
        for i, mount in enumerate(self.mounts):
            block = AttitudeError(
                self.model,
                mount.rows,
                bus.trials,
                numbers // 6,
                bias,
                np.radians(errors.sigma_attitude_deg),
                mount.platform,
                mount.body,
                *target,
                platform_trials,
                self.axes,
                name=f"{self.prefix}attitude_error" + (f"_{i}" if len(self.mounts) > 1 else ""),
            )
            signal = f"{bus.add(block, takes={'measurement': signal}).get_name()}.measurement"
        return signal

    def _misread(self, bus: Bus, signal: str) -> str:
        errors = self.errors
        offsets, root = self._clock_offsets(bus.shape("platforms")[1] // 6)
        if not (np.any(offsets) or np.any(root) or errors.outlier_rate or errors.drop_out_rate):
            return signal
        block = ReadingError(
            self.model,
            self.clock,
            bus.trials,
            offsets,
            root if np.any(root) else None,
            errors.outlier_rate,
            errors.outlier_sigmas,
            errors.drop_out_rate,
            name=f"{self.prefix}reading_error",
        )
        return f"{bus.add(block, takes={'measurement': signal}).get_name()}.measurement"

    def _clock_offsets(self, platforms: int) -> tuple[Array, Array]:
        """Return the offset of each row and what each receiver's clock does to it [s]."""
        errors = self.errors
        share = np.zeros((self.model.size, platforms))
        for row, (receiver, reference) in self.clocks.items():
            i = list(self.model.names).index(row)
            share[i, receiver], share[i, reference] = 1.0, -1.0
        late = errors.clock_offset_platform
        if errors.clock_offset_ns and late >= platforms:
            raise UserError(f"errors.clock_offset_platform: {late} is not allowed; 0 to {platforms - 1}")
        constant = share[:, late] if errors.clock_offset_ns else np.zeros(self.model.size)
        return 1e-9 * errors.clock_offset_ns * constant, 1e-9 * errors.sigma_clock_offset_ns * share


@dataclass(frozen=True)
class KnownPlatforms:
    """What the estimators know of the platforms; publishes ``known``, the true ones where there is no error.

    Attributes
    ----------
    sigma_position, sigma_velocity : float
        Error per axis, constant, drawn per trial [m], [m/s].
    name : str
        Of the block; part of the key of its noise.
    """

    sigma_position: float
    sigma_velocity: float
    name: str = "platform_error"

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        if not (self.sigma_position or self.sigma_velocity):
            bus.publish(known=bus["platforms"])
            return
        own, numbers = bus.shape("platforms")
        block = PlatformError(bus.trials, numbers // 6, self.sigma_position, self.sigma_velocity, own, self.name)
        bus.add(block, gives={"known": "platforms"})


@dataclass(frozen=True)
class NavigationError:
    """A platform's own position as it knows it, off by a Gauss-Markov process; publishes ``known``.

    Attributes
    ----------
    sigma : float
        Per axis [m]; 0: the true one.
    time : float
        Correlation time [s].
    clock : Clock
        When the error is drawn.
    axes : int
        Space dimensions.
    """

    sigma: float
    time: float
    clock: Clock
    axes: int = 3

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        if self.sigma == 0:
            bus.publish(known=bus["platforms"])
            return
        fading = GaussMarkov(self.sigma, self.time, self.axes)
        variance = self.sigma**2 * np.eye(self.axes)
        bus.add(ModelPlant(fading, self.clock, np.zeros(self.axes), variance, bus.trials, name="navigation_error"))
        bus.add(Navigation(bus.trials, self.axes), {"known": "platforms"}, {"error": "navigation_error.state"})
