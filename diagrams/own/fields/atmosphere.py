"""What is in the way of signals, as scenario fields."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.documented import documented, number

__all__ = ["Atmosphere", "Ionosphere", "Troposphere"]


@dataclass
class Troposphere:
    """Air: Saastamoinen's zenith delays, the U.S. Standard Atmosphere with height, Chapman's function of elevation."""

    pressure_hpa: float = number("pressure at sea level [hPa]", 1013.25, at_least=0, at_most=1100)
    temperature_c: float = number("temperature at sea level [degrees Celsius]", 15.0, at_least=-80, at_most=60)
    humidity_percent: float = number("relative humidity at sea level [%]", 50.0, at_least=0, at_most=100)


@dataclass
class Ionosphere:
    """A thin shell of electrons, the same everywhere: delays groups, and advances phases and so Doppler shifts."""

    tec_tecu: float = number("vertical total electron content [TECU = 1e16/m^2]", 20.0, at_least=0, at_most=1000)
    shell_km: float = number("height of the shell [km]", 350.0, at_least=60, at_most=2000)
    carrier_mhz: float | None = number(
        "frequency of signals whose sensor has no carrier_mhz: !Tdoa, !Toa, !Range, !RangeRate [MHz]", None, at_least=1
    )


@dataclass
class Atmosphere:
    """What is in the way of signals; frame earth_fixed only."""

    troposphere: Troposphere | None = documented("air, such as {}; null: none", None)
    ionosphere: Ionosphere | None = documented("electrons, such as {}; null: none", None)
