"""Parts of `beacon_rocket`: the flight with its beacon and stations, and the start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.library.fields.beacon_rocket import ConstantBias, LinearBias, RandomWalkBias, Scenario
from quietfix.diagrams.library.models.beacon_rocket import sensor_mask
from quietfix.diagrams.parts.launch import (
    station_names,
)
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Periodic
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.motion.random_walk import RandomWalk as RandomWalkMotion
from quietfix.systems.plants.joined import Joined
from quietfix.systems.plants.mode_schedule import ModeSchedule
from quietfix.systems.plants.model_plant import ModelPlant
from quietfix.systems.plants.oscillator import BiasLaw, OscillatorBias
from quietfix.systems.plants.recorded_flight import RecordedFlight
from quietfix.systems.plants.rocket import Rocket as RocketPlant
from quietfix.systems.sensors.beacon import BeaconStations
from quietfix.systems.sensors.offset_prior import OffsetPrior
from quietfix.systems.signals import Constant, EnsembleBlock

__all__ = ["BeaconFlight", "OffsetStart"]

Array = NDArray[np.float64]


def _oscillator(scenario: Scenario, clock: Periodic, trials: int) -> EnsembleBlock:
    bias = scenario.bias
    if isinstance(bias, RandomWalkBias):
        walk = RandomWalkMotion([bias.density_m2ps3], ["bias"], ["m/s"])
        return ModelPlant(walk, clock, [bias.bias_mps], [[bias.sigma_bias_mps**2]], trials, name="oscillator")
    if isinstance(bias, ConstantBias):
        law = BiasLaw(bias.bias_mps)
    elif isinstance(bias, LinearBias):
        law = BiasLaw(bias.bias_mps, rate=bias.rate_mps2)
    else:
        per: Any = bias.eps_per
        law = BiasLaw(bias.level_mps, bias.exponent, bias.rate_mps2, bias.sigma_eps_mps, per)
    return OscillatorBias(law, clock, trials)


def _mode_block(scenario: Scenario) -> ModeSchedule:
    mode, names = scenario.mode, station_names(scenario)
    stations = len(names)
    for name, asked in (("late_stations", mode.late_stations), ("uplink_station", [mode.uplink_station])):
        outside = [i for i in asked if not 0 <= i < stations]
        if outside:
            raise UserError(f"mode.{name}: {outside[0]} is not allowed; a station, 0 to {stations - 1}")
    delays = np.zeros(stations)
    delays[mode.late_stations] = mode.late_samples * scenario.period_s
    return ModeSchedule([(w.begin_s, w.end_s) for w in mode.transponder], delays, names)


@dataclass(frozen=True)
class BeaconFlight:
    """Rocket, oscillator and stations: publishes ``target``, ``platforms``, ``measured`` and ``truth``.

    The truth is the rocket's state and acceleration, and the bias that all stations share.
    """

    scenario: Scenario
    clock: Periodic
    vehicle: RocketPlant | RecordedFlight
    positions: Array
    sensor: RangeRate

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        scenario, count_ = self.scenario, len(self.positions)
        vehicle = bus.add(self.vehicle.again(), gives={"target": "state"})
        bus.publish(stage=vehicle.GetOutputPort("stage"), acceleration=vehicle.GetOutputPort("acceleration"))
        still = np.concatenate([self.positions, np.zeros_like(self.positions)], axis=1)
        bus.add(Constant("sites", still.ravel()), gives={"platforms": "state"})
        bus.add(_oscillator(scenario, self.clock, bus.trials), gives={"bias": "state"})
        bus.add(_mode_block(scenario), gives={"mode": "mode"})
        stations = BeaconStations(
            self.sensor,
            self.clock,
            bus.trials,
            count_,
            target_trials=bus.shape("target")[0],
            bias_trials=bus.shape("bias")[0],
            uplink=scenario.mode.uplink_station,
            sigma_residual=scenario.sensor.sigma_station_residual_mps,
            mask=sensor_mask(scenario),
        )
        bus.add(stations, gives={"measured": "measurement", "common": "common"})
        parts = ("target", "acceleration", "common")
        bus.add(Joined({signal: bus.shape(signal) for signal in parts}), gives={"truth": "state"})


@dataclass(frozen=True)
class OffsetStart:
    """Publishes ``initial_estimate_10`` and ``initial_estimate_9``, off by what the scenario says."""

    scenario: Scenario

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        initial, trials = self.scenario.initial, bus.shape("truth")[0]
        offsets = [initial.position_m] * 3 + [initial.velocity_mps] * 3 + [0.0] * 4
        signs, sizes = [True] * 9 + [False], (10, 9)
        prior = OffsetPrior(
            offsets, signs, sizes, self.scenario.start_s, bus.trials, trials, random_signs=initial.random_signs
        )
        bus.add(prior, gives={f"initial_estimate_{size}": f"initial_estimate_{size}" for size in sizes})
