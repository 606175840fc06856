"""Errors that no estimator knows of, put on the wires between truth and estimators."""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, OutputPort

from diagrams.errors import UserError
from systems.clocks import Clock
from systems.documented import count, number
from systems.measurement.base import MeasurementModel
from systems.sensors.attitude_error import AttitudeError
from systems.sensors.platform_error import PlatformError
from systems.sensors.reading_error import ReadingError

__all__ = ["NO_CLOCKS", "Place", "Seat", "SensorErrors", "known_platforms", "refuse", "spoil"]

Array = NDArray[np.float64]

NO_CLOCKS = {"clock_offset": "no times of arrival are compared here"}
"""For `refuse`."""


@dataclass
class SensorErrors:
    """Errors of the sensors that the estimators do not know of; all off by default."""

    attitude_roll_deg: float = number("the sensor's axes are turned about x (along the track) [deg]", 0.0)
    attitude_pitch_deg: float = number("about y (across the track) [deg]", 0.0)
    attitude_yaw_deg: float = number("about z (to nadir; in a local frame up) [deg]", 0.0)
    sigma_attitude_deg: float = number("a further turn about each axis, drawn per trial [deg]", 0.0, at_least=0)
    clock_offset_ns: float = number("one receiver's clock is ahead by this: it writes too late a time [ns]", 0.0)
    clock_offset_platform: int = count("which receiver's; 0 is the reference of every TDOA", 0, at_least=0)
    sigma_clock_offset_ns: float = number("offset of every receiver's clock, drawn per trial [ns]", 0.0, at_least=0)
    sigma_platform_position_m: float = number(
        "error of the known position of every platform, constant, per axis, drawn per trial [m]", 0.0, at_least=0
    )
    sigma_platform_velocity_mps: float = number("the same of the known velocity [m/s]", 0.0, at_least=0)
    drop_out_rate: float = number("share of the rows that are missing", 0.0, at_least=0, at_most=1)
    outlier_rate: float = number("share of the rows with a gross error", 0.0, at_least=0, at_most=1)
    outlier_sigmas: float = number("standard deviation of a gross error, in sigmas of the row", 20.0, above=0)


@dataclass(frozen=True)
class Seat:
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
class Place:
    """Where in a diagram a sensor is.

    Attributes
    ----------
    model : MeasurementModel
        What the sensor measures.
    clock : Clock
        When.
    measured, target, platforms : OutputPort
        Its output, the true target, the true platforms.
    trials, platform_count : int
        Trials of the measurement, number of carriers.
    axes : int
        Space dimensions of the target's state.
    seats : sequence of Seat
        Who measures directions.
    clocks : mapping of str to (int, int)
        Rows that compare two receivers' times of arrival [s]: the receiver and the reference.
    """

    model: MeasurementModel
    clock: Clock
    measured: OutputPort
    target: OutputPort
    platforms: OutputPort
    trials: int
    platform_count: int
    axes: int = 3
    seats: Sequence[Seat] = ()
    clocks: dict[str, tuple[int, int]] = field(default_factory=dict)


def refuse(errors: SensorErrors, path: str, senseless: dict[str, str]) -> None:
    """Refuse errors that a system has not.

    Parameters
    ----------
    errors : SensorErrors
    path : str
        Where they are in the scenario.
    senseless : dict of str to str
        Beginning of the field's name (after ``sigma_``), and why.

    Raises
    ------
    UserError
        For the first one that is on.
    """
    for one in fields(errors):
        value = getattr(errors, one.name)
        for begin, why in senseless.items():
            if value and value != one.default and one.name.removeprefix("sigma_").startswith(begin):
                raise UserError(f"{path}.{one.name}: {value:g} is not allowed; {why}")


def spoil(builder: DiagramBuilder, errors: SensorErrors, place: Place) -> OutputPort:
    """Put the errors that are on behind a sensor; return what estimators, gates and resolvers get.

    With all of them off nothing is added and the sensor's own port is returned.
    """
    measured = place.measured
    bias = np.radians([errors.attitude_roll_deg, errors.attitude_pitch_deg, errors.attitude_yaw_deg])
    if np.any(bias) or errors.sigma_attitude_deg:
        for i, seat in enumerate(place.seats):
            target, platforms = _shape(place.target), _shape(place.platforms)
            block = builder.AddSystem(
                AttitudeError(
                    place.model,
                    seat.rows,
                    place.trials,
                    place.platform_count,
                    bias,
                    np.radians(errors.sigma_attitude_deg),
                    seat.platform,
                    seat.body,
                    *target,
                    platforms[0],
                    place.axes,
                    name="attitude_error" + (f"_{i}" if len(place.seats) > 1 else ""),
                )
            )
            for port, source in (("measurement", measured), ("target", place.target), ("platforms", place.platforms)):
                builder.Connect(source, block.GetInputPort(port))
            measured = block.GetOutputPort("measurement")
    offsets, root = _clock_offsets(errors, place)
    if np.any(offsets) or np.any(root) or errors.outlier_rate or errors.drop_out_rate:
        block = builder.AddSystem(
            ReadingError(
                place.model,
                place.clock,
                place.trials,
                offsets,
                root if np.any(root) else None,
                errors.outlier_rate,
                errors.outlier_sigmas,
                errors.drop_out_rate,
            )
        )
        builder.Connect(measured, block.GetInputPort("measurement"))
        measured = block.GetOutputPort("measurement")
    return measured


def _clock_offsets(errors: SensorErrors, place: Place) -> tuple[Array, Array]:
    """Return the offset of each row and what each receiver's clock does to it [s]."""
    share = np.zeros((place.model.size, place.platform_count))
    for row, (receiver, reference) in place.clocks.items():
        i = list(place.model.names).index(row)
        share[i, receiver], share[i, reference] = 1.0, -1.0
    late = errors.clock_offset_platform
    if errors.clock_offset_ns and late >= place.platform_count:
        raise UserError(f"errors.clock_offset_platform: {late} is not allowed; 0 to {place.platform_count - 1}")
    constant = share[:, late] if errors.clock_offset_ns else np.zeros(place.model.size)
    return 1e-9 * errors.clock_offset_ns * constant, 1e-9 * errors.sigma_clock_offset_ns * share


def known_platforms(
    builder: DiagramBuilder, errors: SensorErrors, platforms: OutputPort, trials: int, count: int
) -> tuple[OutputPort, int]:
    """Return what the estimators know of the platforms, and its trials; the true ones where no error is on."""
    own = _shape(platforms)[0]
    if not (errors.sigma_platform_position_m or errors.sigma_platform_velocity_mps):
        return platforms, own
    block = builder.AddSystem(
        PlatformError(
            trials, count, errors.sigma_platform_position_m, errors.sigma_platform_velocity_mps, platform_trials=own
        )
    )
    builder.Connect(platforms, block.GetInputPort("platforms"))
    return block.GetOutputPort("platforms"), trials


def _shape(port: OutputPort) -> tuple[int, int]:
    block: Any = port.get_system()
    size: tuple[int, int] = block.output_size(port.get_name())
    return size
