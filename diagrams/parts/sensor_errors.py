"""Errors of sensors that no estimator knows of: scenario fields; `impairment` puts them on a bus."""

from __future__ import annotations

from dataclasses import dataclass, fields

from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import count, number

__all__ = ["NO_CLOCKS", "CommonErrors", "SensorErrors", "refuse"]


NO_CLOCKS = {"clock_offset": "no times of arrival are compared here"}
"""For `refuse`."""


@dataclass
class CommonErrors:
    """Errors of sensors that the estimators do not know of, whatever the sensors' platforms are called."""

    attitude_roll_deg: float = number("the sensor's axes are turned about x (along the track) [deg]", 0.0)
    attitude_pitch_deg: float = number("about y (across the track) [deg]", 0.0)
    attitude_yaw_deg: float = number("about z (to nadir; in a local frame up) [deg]", 0.0)
    sigma_attitude_deg: float = number("a further turn about each axis, drawn per trial [deg]", 0.0, at_least=0)
    clock_offset_ns: float = number("one receiver's clock is ahead by this: it writes too late a time [ns]", 0.0)
    sigma_clock_offset_ns: float = number("offset of every receiver's clock, drawn per trial [ns]", 0.0, at_least=0)
    sigma_platform_position_m: float = number(
        "error of the known position of every platform, constant, per axis, drawn per trial [m]", 0.0, at_least=0
    )
    sigma_platform_velocity_mps: float = number("the same of the known velocity [m/s]", 0.0, at_least=0)
    drop_out_rate: float = number("share of the rows that are missing", 0.0, at_least=0, at_most=1)
    outlier_rate: float = number("share of the rows with a gross error", 0.0, at_least=0, at_most=1)
    outlier_sigmas: float = number("standard deviation of a gross error, in sigmas of the row", 20.0, above=0)


@dataclass
class SensorErrors(CommonErrors):
    """Errors of the sensors that the estimators do not know of; all off by default."""

    clock_offset_platform: int = count("whose clock; 0 is the reference of every TDOA", 0, at_least=0)


def refuse(errors: CommonErrors, path: str, senseless: dict[str, str]) -> None:
    """Refuse errors that a system has not.

    Parameters
    ----------
    errors : CommonErrors
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
                shown = value if isinstance(value, str) else f"{value:g}"
                raise UserError(f"{path}.{one.name}: {shown} is not allowed; {why}")
