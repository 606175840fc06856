"""Parts of `satellite_ranging`: the satellite that is heard, and what an estimator that looks ahead is given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.library.fields.satellite_ranging import Scenario
from quietfix.diagrams.library.models.satellite_ranging import gravity
from quietfix.diagrams.parts.sensor_errors import SensorErrors
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.plants.recorded import RecordedTruth
from quietfix.systems.sensors.platform_error import PlatformError
from quietfix.systems.sensors.preview import Preview

__all__ = ["OrbitingTarget", "add_preview", "orbit_block"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OrbitingTarget:
    """The satellite that is heard: publishes ``target`` and ``truth``."""

    solved: Callable[[], DenseOrbit | RecordedTruth]

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        block = self.solved().again()
        port = "inertial" if isinstance(block, DenseOrbit) else "state"
        bus.add(block, gives={"target": port, "truth": port})


def orbit_block(scenario: Scenario, state: Array, name: str) -> DenseOrbit:
    """Return the block of a satellite that begins in an inertial state (6,)."""
    constants = gravity(scenario)
    return DenseOrbit(state[None], scenario.duration_s, constants=constants, j2=scenario.truth.j2, name=name)


def add_preview(scenario: Scenario, clock: Periodic, bus: Bus, block: Estimator) -> str:
    """Add what the sensor will read, for an estimator that looks ahead; return its signal."""
    per_epoch = bus.shape("measured")[1] + bus.shape("platforms")[1]
    name, epochs = block.get_name(), block.GetInputPort("preview").size() // (bus.trials * per_epoch)
    if scenario.truth.errors != SensorErrors():
        raise UserError(
            f"estimators.{name}: {name} is not allowed with truth.errors; it is given what the sensor will read"
        )
    span = clock.period * (epochs - 1)
    if scenario.duration_s < span:
        raise UserError(
            f"duration_s: {scenario.duration_s:g} is not allowed; {name} looks ahead, at least {span:g} s are needed"
        )
    sensor, observer, target = (bus[signal].get_system() for signal in ("measured", "platforms", "target"))
    known = bus["known"].get_system()
    error = known if isinstance(known, PlatformError) else None
    bus.add(Preview(sensor, target.at, observer.at, clock, epochs, error, f"preview_{name}"))
    return f"preview_{name}.preview"
