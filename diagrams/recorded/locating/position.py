"""Where an emitter is: differences written as a system of a user's own, which is then run as any other."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.own.declaring.sensing import placed_sensors
from quietfix.diagrams.own.fed.measured import measured, setting_of, table_of_scenario
from quietfix.diagrams.own.fed.report import MeasuredReport
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.system import own_system, places_of
from quietfix.diagrams.parts.formation import gravity_constants
from quietfix.diagrams.paths.functions import paths_of
from quietfix.diagrams.readers.stamps import write_stamps
from quietfix.diagrams.recorded.locating.receivers import Known
from quietfix.diagrams.recorded.locating.rows import Rows, at_once, write_rows
from quietfix.diagrams.recorded.settings.position_settings import PositionSettings
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import join
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from quietfix.systems.fixes.snapshot import starts_around, starts_around_level
from quietfix.systems.fixes.standing import StandingFix, averaged, standing_fix
from quietfix.systems.measurement.stack import Stack

__all__ = ["FOLDER", "Heard", "Located", "locate"]

Array = NDArray[np.float64]

FOLDER = "fix"
"""Name of the folder of the system that was written: within it ``quietfix run fix.yaml`` gives the same estimates."""

_MOST_EPOCHS = 60  # of receivers that move, in the fix that a run starts from
_ROUNDED = 2e-6  # s
_WIDER = 10.0  # of the start, in sigmas of the fix from all epochs: a hundredth of what is known counts twice
_LEAST = 0.1  # m
_BENDS = 30e6  # Hz
_DEEPEST = -500.0  # m: what is below is under the ground
_STILL = 1e-3  # m/s: what a velocity that is zero may be
_CORRELATED = 0.25  # between none and the half of differences with equal errors


@dataclass(frozen=True, eq=False)
class Heard:
    """What was measured.

    Attributes
    ----------
    reference : str
        Receiver that the others were compared with.
    carrier : float
        [Hz]; 0: nobody knows.
    began : (int, float), optional
        Time 0 in seconds of TAI since 1970.
    times : ndarray, shape (times,)
        [s]
    tdoa, fdoa : sequence of Rows
        By receiver.
    coherence : float
        Of two receivers, 0 to 1.
    """

    reference: str
    carrier: float
    began: tuple[int, float] | None
    times: Array
    tdoa: Sequence[Rows]
    fdoa: Sequence[Rows]
    coherence: float


@dataclass(frozen=True, eq=False)
class Located:
    """What is known of the place then.

    Attributes
    ----------
    report : MeasuredReport or None
        Of the run; None: there is no fix.
    notes : list of str
        What a reader must know; why there is no fix.
    """

    report: MeasuredReport | None
    notes: list[str]


def locate(heard: Heard, known: Known, settings: PositionSettings, folder: Path) -> Located:
    """Write a system into a folder, and run it.

    Parameters
    ----------
    heard : Heard
    known : Known
        Where the receivers are.
    settings : PositionSettings
    folder : Path
        An empty one.
    """
    notes = [f"position: nobody knows where {', '.join(known.absent)} stands: left out"] if known.absent else []
    if heard.reference not in known.names:
        return Located(None, [f"no fix: nobody knows where the reference {heard.reference} stands"])
    tdoa = [rows for rows in heard.tdoa if rows.receiver in known.names and rows.there.any()]
    fdoa = [rows for rows in heard.fdoa if rows.receiver in known.names and rows.there.any()]
    if not tdoa:
        return Located(None, [*notes, "no fix: nothing was measured between receivers whose places are known"])
    if not _doppler(settings, known, heard.carrier):
        fdoa = []
        if settings.fdoa == "used":
            notes.append("position: FDOA is left out: nobody knows the carrier (core:frequency)")
    if settings.speed_mps == 0 and not known.moving:
        both = [at_once(rows, heard.times.size // 2) for rows in (*tdoa, *fdoa)]
        tdoa, fdoa = [rows for rows, _ in both[: len(tdoa)]], [rows for rows, _ in both[len(tdoa) :]]
        notes += [
            f"position: differences at {rows.receiver} scatter {larger:.2g} times as much as their sigmas, which are "
            "enlarged"
            for rows, larger in both
            if larger > 1
        ]
        notes.append("position: of all times together, from a start at their own fix, so that its NIS says nothing")
    height = _height_row(settings, tdoa)
    write_rows(folder / "measurements.csv", heard.began, heard.times, [*tdoa, *fdoa, *height])
    (folder / f"platforms{known.suffix}").write_bytes(known.content)
    text = _system(heard, known, settings, tdoa, fdoa, bool(height))
    file = folder / "fix.yaml"
    start = "!Given {sigma_velocity_mps: 1}"
    if settings.speed_mps > 0:
        sensors = "[tdoa, height]" if height else "[tdoa]"
        start = f"!Snapshot {{sensors: {sensors}, sigma_velocity_mps: {settings.speed_mps!r}}}"
        if len(tdoa) + bool(height) < 3:
            return Located(None, [*notes, _undetermined(tdoa, bool(height), known)])
    file.write_text(f"{text}start: {start}\n", encoding="utf-8")
    if not settings.speed_mps > 0:
        fix = _fix(file)
        if not np.isfinite(fix.position).all():
            file.unlink()
            if fix.dof >= 0 and (len(tdoa) > 1 or known.moving):
                return Located(None, [*notes, "no fix: the rows contradict each other; no place fits them"])
            return Located(None, [*notes, _undetermined(tdoa, bool(height), known)])
        file.write_text(f"{text}start: {_given(fix, settings)}\n", encoding="utf-8")
        notes += _ambiguous(fix, settings)
    if height:
        notes.append(
            f"position: its height was taken to be {settings.height_m:g} m, with a standard deviation of "
            f"{settings.sigma_height_m:g} m (position.height_m, position.sigma_height_m)"
        )
    if 0 < heard.carrier < _BENDS:
        notes.append(
            f"position: at {1e-3 * heard.carrier:.6g} kHz waves follow the ground and the ionosphere; straight lines "
            "are assumed, and its sigmas do not tell of that"
        )
    study = Study(str(file))
    report = study.report(join(list(study.chunks(False))))
    assert isinstance(report, MeasuredReport)
    return Located(replace(report, system="position"), notes)


def _doppler(settings: PositionSettings, known: Known, carrier: float) -> bool:
    """Return whether FDOA tells of the place: where nothing moves, it only tells of oscillators."""
    moving = known.moving or settings.speed_mps > 0
    return carrier > 0 and (settings.fdoa == "used" or (settings.fdoa == "auto" and moving))


def _height_row(settings: PositionSettings, tdoa: Sequence[Rows]) -> list[Rows]:
    """Return what is assumed of the height, once: at the first time with three differences, or as many as there are."""
    if settings.sigma_height_m is None:
        return []
    count = np.sum([rows.there for rows in tdoa], axis=0)
    at = int(np.argmax(count >= min(3, int(count.max()))))
    value, sigma = np.full(count.size, np.nan), np.full(count.size, np.nan)
    value[at], sigma[at] = settings.height_m, settings.sigma_height_m
    return [Rows("altitude", "", "", "m", value, sigma)]


def _system(
    heard: Heard, known: Known, settings: PositionSettings, tdoa: Sequence[Rows], fdoa: Sequence[Rows], height: bool
) -> str:
    """Return the file of a system, but for its start."""
    used = [heard.reference, *dict.fromkeys(rows.receiver for rows in (*tdoa, *fdoa))]
    # errors at the reference are in every difference; noise that is much stronger than the signal is each pair's own
    noise = 1 / max(heard.coherence, 1e-6) - 1
    correlated = str(len(tdoa) > 1 and 1 / (2 + noise) > _CORRELATED).lower()
    once = all(np.count_nonzero(rows.there) == 1 for rows in (*tdoa, *fdoa))
    begin = 0.0 if once or heard.began is None else min(float(heard.times[rows.there][0]) for rows in tdoa)
    lines = [
        "# Where an emitter is, from differences of I/Q recordings. `quietfix run fix.yaml` gives the same estimates.",
        f"frame: {settings.frame}",
        f"duration_s: {round(float(heard.times[-1]) - begin + _ROUNDED, 6)!r}",
        # a run has a length: a single time is not its beginning
        *([f"start_utc: {write_stamps(heard.began, np.zeros(1))[0]}"] if once and heard.began is not None else []),
        "platforms:",
    ]
    for name in used:
        inside = f"{{file: platforms{known.suffix}, name: {json.dumps(known.names[name])}}}"
        lines.append(f"  {name}: !Platform {inside}")
    lines.append("sensors:")
    common = f"reference: {heard.reference}, correlated: {correlated}"
    if tdoa:
        sigma = float(np.median(np.concatenate([rows.sigma[rows.there] for rows in tdoa])))
        names = ", ".join(rows.receiver for rows in tdoa)
        lines.append(f"  tdoa: !Tdoa {{{common}, receivers: [{names}], sigma_ns: {1e9 * sigma!r}}}")
    if fdoa:
        sigma = float(np.median(np.concatenate([rows.sigma[rows.there] for rows in fdoa])))
        names, carrier = ", ".join(rows.receiver for rows in fdoa), f"carrier_mhz: {1e-6 * heard.carrier!r}"
        lines.append(f"  fdoa: !Fdoa {{{common}, receivers: [{names}], sigma_hz: {sigma!r}, {carrier}}}")
    if height:
        lines.append(f"  height: !Altitude {{sigma_m: {settings.sigma_height_m!r}}}     # assumed, and told once")
    density = settings.density_m2ps3 if settings.speed_mps > 0 else 0.0
    lines += [
        "measurements: {file: measurements.csv}",
        f"belief: {{motion: !WhiteNoiseAcceleration {{density_m2ps3: {density!r}}}}}",
        "estimators: {iekf: !Iekf {}}",
    ]
    return "\n".join(lines) + "\n"


def _fix(file: Path) -> StandingFix:
    """Return the place of what stands still, from all rows of a system's table."""
    scenario = own_system(file).load()
    assert isinstance(scenario, OwnScenario)
    folder = file.parent
    table = table_of_scenario(scenario, folder)
    assert table is not None
    setting, places = setting_of(scenario, folder, table), places_of(scenario)
    movers = {f"platforms.{name}": one for name, one in scenario.platforms.items()}
    paths = paths_of(movers, scenario.axes, setting, gravity_constants(scenario.constants))

    def platforms(t: float) -> Array:
        return np.concatenate([path(t) for path in paths])

    kinds = [kind for one in placed_sensors(scenario, places) for kind in one.kinds]
    fed = measured(scenario, setting, table, kinds, places, {}, platforms)
    track = fed.tracks[0]
    sigma = np.broadcast_to(np.sqrt(np.diagonal(fed.noise_covariance)), track.value.shape)
    sigma = sigma if track.scale is None else sigma * track.scale
    ticks = track.clock.ticks(np.inf)
    value = track.value
    states = np.array([platforms(float(t)).reshape(-1, 6) for t in ticks])
    if (np.ptp(states, axis=0) == 0).all():
        value, sigma = averaged(value, sigma)
        states = states[:1]
    elif ticks.size > _MOST_EPOCHS:
        picked = np.unique(np.linspace(0, ticks.size - 1, _MOST_EPOCHS).astype(int))
        rows = [kind.believed.names[0] for kind in kinds]
        picked = np.union1d(picked, np.flatnonzero(np.isfinite(value[:, -1]))) if "altitude" in rows else picked
        value, sigma, states = value[picked], sigma[picked], states[picked]
    around = starts_around_level if scenario.axes.flat else starts_around
    everywhere = np.concatenate(states)[None]
    starts = np.concatenate([around(everywhere, np.array([h]), 8)[0] for h in (0.0, 10e3)])
    fix = standing_fix(value, sigma, states, Stack([kind.believed for kind in kinds]), starts)
    return fix if scenario.axes.flat else _above_ground(fix)


def _above_ground(fix: StandingFix) -> StandingFix:
    """Return a fix without those places that are under the ground, if there are others."""
    places = [fix.position, *fix.others]
    above = [place for place in places if _geodetic(place)[2] >= _DEEPEST] or places
    return fix._replace(position=above[0], others=np.array(above[1:]).reshape(-1, 3))


def _given(fix: StandingFix, settings: PositionSettings) -> str:
    """Return the start of a run: there, and much less well known than it is."""
    spread = max(_LEAST, _WIDER * math.sqrt(float(np.linalg.eigvalsh(fix.covariance)[-1])))
    sigmas = f"sigma_position_m: {spread!r}, sigma_velocity_mps: {_STILL}"
    if settings.frame == "local":
        x, y, z = (float(one) for one in fix.position)
        return f"!Given {{at: !Fixed {{east_km: {1e-3 * x!r}, north_km: {1e-3 * y!r}, up_m: {z!r}}}, {sigmas}}}"
    latitude, longitude, height = _geodetic(fix.position)
    where = f"latitude_deg: {latitude!r}, longitude_deg: {longitude!r}, height_m: {max(height, -499.0)!r}"
    return f"!Given {{at: !Geodetic {{{where}}}, {sigmas}}}"


def _geodetic(position: Array) -> tuple[float, float, float]:
    latitude, longitude, height = (float(one) for one in ecef_to_geodetic(position))
    return math.degrees(latitude), math.degrees(longitude), height


def _ambiguous(fix: StandingFix, settings: PositionSettings) -> list[str]:
    """Return a note on places that fit as well."""
    if not len(fix.others):
        return []
    if settings.frame == "local":
        shown = ["x {:.0f}, y {:.0f}, z {:.0f} m".format(*other) for other in fix.others[:3]]
    else:
        shown = ["{:.5f}, {:.5f}, {:.0f} m".format(*_geodetic(other)) for other in fix.others[:3]]
    return [f"position: the rows fit as well at {' and '.join(shown)}"]


def _undetermined(tdoa: Sequence[Rows], height: bool, known: Known) -> str:
    """Return why there is no fix."""
    if len(tdoa) == 1 and not known.moving:
        return (
            "no fix: a time difference of two receivers that stand is one hyperbola, on which the emitter may be "
            "anywhere; a third receiver is needed, or one that moves"
        )
    what = f"{len(tdoa)} time difference(s){' and the height' if height else ''}"
    return f"no fix: {what} do not determine a place; one more receiver, or position.sigma_height_m, is needed"
