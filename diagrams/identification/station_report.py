"""What `quietfix identify` tells of a station that it located: a table, a verdict in words, numbers and a map."""

from __future__ import annotations

from typing import Any

import numpy as np

from quietfix.diagrams.console.tables import Column, Styled, Table, three_digits
from quietfix.diagrams.identification.locating import Located, Place
from quietfix.diagrams.identification.priors import Priors
from quietfix.diagrams.readers.doppler.received import Received
from quietfix.diagrams.statistics.json_numbers import json_numbers
from quietfix.diagrams.writers.ellipse import ellipse_ring
from quietfix.diagrams.writers.meridian import cut_ring
from quietfix.systems.constants import SPEED_OF_LIGHT

__all__ = ["station_entry", "station_geojson", "station_table", "station_verdict"]

_POSSIBLE = 0.01
_WORDS = ("the more likely one", "on the other side of the track")


def station_table(located: Located, received: Received) -> Table:
    """Return the table that is printed: the best place, and that on the other side of the track."""
    table = Table(
        f"{received.path.name}: {np.count_nonzero(located.used)} of {located.used.size} rows, "
        f"{located.elements.label}, carrier {received.carrier / 1e6:.6f} MHz",
        [Column("place"), "latitude [deg]", "longitude [deg]", "half axes, 99 % [km]", "towards [deg]", "probability"],
        caption="half axes: of the ellipse that holds the station with 99 %, if it is this place; towards: of the "
        "longer one, clockwise from north.",
    )
    for i, (one, words) in enumerate(zip(located.places, _WORDS, strict=False)):
        long, short, towards = one.axes
        style = ("yellow" if located.doubts else "green") if i == 0 else ""
        table.add(
            Styled(words if len(located.places) > 1 else "the only one", style),
            f"{one.latitude:.4f}",
            f"{one.longitude:.4f}",
            f"{three_digits(long / 1e3)} x {three_digits(short / 1e3)}",
            f"{towards:.0f}",
            f"{one.probability:.4f}",
        )
    return table


def station_verdict(located: Located) -> str:
    """Return what is to be believed, in a sentence or two."""
    best = located.places[0]
    long, short, _ = best.axes
    where = (
        f"{best.latitude:.4f}, {best.longitude:.4f} deg, within {three_digits(long / 1e3)} x "
        f"{three_digits(short / 1e3)} km (99 %)"
    )
    if not located.doubts:
        return f"located: {where}"
    doubt = "; ".join(located.doubts)
    if len(located.places) > 1 and located.places[1].probability > _POSSIBLE:
        other = located.places[1]
        where += f", nor for {other.latitude:.4f}, {other.longitude:.4f} deg on the other side of the track"
    return f"cannot vouch for {where}: {doubt}"


def station_entry(located: Located, received: Received, priors: Priors) -> dict[str, Any]:
    """Return what ``station.json`` holds."""
    hertz = received.carrier / SPEED_OF_LIGHT
    names = ("bias_hz", "drift_hzps", "drift_rate_hzps2", "further_hzps3")[: priors.order + 1]
    return {
        "schema_version": 1,
        "verdict": station_verdict(located),
        "vouched": not located.doubts,
        "doubts": located.doubts,
        "object": located.elements.number,
        "name": located.elements.name,
        "carrier_hz": received.carrier,
        "rows": int(located.used.size),
        "rows_used": int(np.count_nonzero(located.used)),
        "sigma_block_mps": located.scale,
        "blocks_together": located.together,
        "systematic": json_numbers(located.systematic),
        "notes": [*received.notes, *located.notes],
        "places": [_place(one, names, hertz, priors.order + 1) for one in located.places],
    }


def _place(one: Place, names: tuple[str, ...], hertz: float, order: int) -> dict[str, Any]:
    long, short, towards = one.axes
    states = one.fit.estimate[:-4].reshape(-1, order)
    return {
        "latitude_deg": one.latitude,
        "longitude_deg": one.longitude,
        "height_m": one.height,
        "covariance_east_north_m2": json_numbers(one.covariance),
        "half_axes_99_m": [long, short],
        "towards_deg": towards,
        "probability": one.probability,
        **{name: json_numbers(-states[:, i] * hertz) for i, name in enumerate(names)},
        "ahead_s": one.ahead,
        "sigma_ahead_s": float(one.fit.sigma[-4]),
        "likelihood_at_edge": one.bent,
    }


def station_geojson(located: Located) -> dict[str, Any]:
    """Return places and their 99 % ellipses as GeoJSON."""
    features = []
    for one in located.places:
        about = {"object": located.elements.label, "probability": one.probability, "vouched": not located.doubts}
        point = {"type": "Point", "coordinates": [one.longitude, one.latitude]}
        features.append({"type": "Feature", "geometry": point, "properties": {**about, "kind": "station"}})
        ring, _ = ellipse_ring(one.latitude, one.longitude, one.height, one.radius * one.covariance)
        rings = [[np.asarray(part).tolist() for part in whole] for whole in cut_ring(ring)]
        shape = {"type": "MultiPolygon", "coordinates": rings}
        features.append({"type": "Feature", "geometry": shape, "properties": {**about, "kind": "99 % ellipse"}})
    return {"type": "FeatureCollection", "features": features}
