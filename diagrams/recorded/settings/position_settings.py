"""How an emitter is located from differences between I/Q recordings; a part of `iq_settings`."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.documented import choice, number

__all__ = ["PositionSettings"]


@dataclass
class PositionSettings:
    """What is assumed of the emitter; used where it is known where receivers stand."""

    frame: str = choice("axes of x, y, z in the table of platforms", "earth_fixed", ("earth_fixed", "local"))
    height_m: float = number("height that the emitter is taken to have, above the ellipsoid, or z", 0.0)
    sigma_height_m: float | None = number("its standard deviation; null: nothing is assumed", 1000.0, above=0)
    speed_mps: float = number("standard deviation of the emitter's speed per axis; 0: it stands", 0.0, at_least=0.0)
    density_m2ps3: float = number("of an emitter that moves: spectral density of its acceleration", 0.1, at_least=0.0)
    fdoa: str = choice(
        "whether FDOA counts; auto: where receivers or emitter move", "auto", ("auto", "used", "left_out")
    )
