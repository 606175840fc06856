"""Starts from the first measurement of a system of one's own, as scenario fields."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.documented import choice, documented, number, text

__all__ = ["KnownHeight", "Snapshot"]


@dataclass
class Snapshot:
    """A least-squares fix of the first measurement alone, at rest; its rows must not depend on the velocity."""

    sensors: list[str] = documented("sensors or kinds of a !Joint whose rows make the fix; empty: all", factory=list)
    height_m: float = number("height at which the search begins [m]", 0.0)
    sigma_velocity_mps: float = number("the velocity is 0 with this standard deviation per axis [m/s]", 50.0, above=0)


@dataclass
class KnownHeight:
    """A fix from the first two time differences of arrival and an assumed height, at rest; frame earth_fixed."""

    sensor: str = text("a !Tdoa of two rows; empty: the only one")
    sigma_height_m: float = number("error of the height, drawn about the truth in every trial [m]", 1000.0, above=0)
    sigma_velocity_mps: float = number("the velocity is 0 with this standard deviation per axis [m/s]", 400.0, above=0)
    believed_sigma_height_m: float | None = number(
        "the same as the estimators believe it to be [m]; null: as it is", None, above=0
    )
    sigma_platform_m: float = number(
        "error of a platform's position per axis, in the covariance of the start only [m]", 0.0, at_least=0
    )
    method: str = choice("how it is solved", "auto", ("auto", "closed_form", "newton"))
