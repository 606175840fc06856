"""What `quietfix gdop` draws of a system of one's own, as a scenario field."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.assembly.map import View
from quietfix.diagrams.paths.functions import path_of
from quietfix.diagrams.paths.movers import Mover
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.quantities.frame import Frame
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import choice, documented, number
from quietfix.systems.trajectories.gravity import GravityConstants

__all__ = ["Map", "view_of"]

_KM = 1e3


@dataclass
class Map:
    """A map of the bound: the target's course is moved about on a grid; null: as without a map."""

    extent_km: float | None = number(
        "from the middle to a side [km]; null: a tenth beyond the furthest platform", None, above=0
    )
    spacing_km: float | None = number("between points side by side [km]; null: 31 points, or fewer", None, above=0)
    centre: Mover | None = documented("what is over or below the middle at t = 0; null: the target", None)
    height_m: float | None = number("height of the points, z or above the ellipsoid [m]; null: the target's", None)
    plane: str = choice(
        "level; east_up, north_up: upright through the middle", "level", ("level", "east_up", "north_up")
    )
    top_km: float | None = number(
        "top of an upright plane, from 0 [km]; null: twice the height, at least a quarter of extent_km", None, above=0
    )


def view_of(field: Map | None, frame: Frame, setting: Setting, constants: GravityConstants) -> View:
    """Return what a map shows.

    Raises
    ------
    UserError
        If a field means nothing in the frame or beside another.
    """
    if field is None:
        return View()
    for name in ("height_m", "plane"):
        value = getattr(field, name)
        if frame.height is None and value not in (None, "level"):
            shown = value if isinstance(value, str) else f"{value:g}"
            raise UserError(f"map.{name}: {shown} is not allowed in frame {frame.name}; local or earth_fixed")
    if field.top_km is not None and field.plane == "level":
        raise UserError(f"map.top_km: {field.top_km:g} is not allowed on a level plane; east_up or north_up")
    centre = None
    if field.centre is not None:
        centre = path_of(field.centre, frame, setting, constants, "map.centre")(0.0)[:3]
    return View(centre, field.height_m, field.plane, *map(_metres, (field.extent_km, field.spacing_km, field.top_km)))


def _metres(value: float | None) -> float | None:
    return None if value is None else value * _KM
