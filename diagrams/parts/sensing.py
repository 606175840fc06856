"""Parts that measure the target from the platforms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from quietfix.diagrams.assembly.bus import Bus
from quietfix.systems.clocks import Clock
from quietfix.systems.geometry.visibility import Mask
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.sensors.sensor import Sensor

__all__ = ["TargetSensor"]


@dataclass(frozen=True)
class TargetSensor:
    """A sensor that sees the target from the platforms; what it reads is the signal of its name.

    Attributes
    ----------
    name : str
        Of the block; part of the key of its noise.
    model : MeasurementModel
        What it measures.
    clock : Clock
        When.
    mask : Mask, optional
        What hides the target from a platform.
    gives : sequence of str
        Further signals that its measurement is.
    """

    name: str
    model: MeasurementModel
    clock: Clock
    mask: Mask | None = None
    gives: Sequence[str] = ()

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        (target_trials, size), (platform_trials, numbers) = bus.shape("target"), bus.shape("platforms")
        if numbers % 6:
            raise ValueError(f"signal: platforms of {numbers} numbers is not allowed; six for each platform")
        sensor = Sensor(
            self.model,
            self.clock,
            bus.trials,
            numbers // 6,
            target_trials,
            size,
            platform_trials,
            self.mask,
            self.name,
        )
        bus.add(sensor, gives=dict.fromkeys((self.name, *self.gives), "measurement"))
