"""What travels on the ports: meaning, unit and frame, by the port's name; named numbers bring their own units."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from quietfix.systems.signals import EnsembleBlock

from .standing import TRIALS, Standing

__all__ = ["Port", "ports_of"]

STATE = "m, m/s"
SYSTEM = "the system's"
NONE = ""
SI = "SI of the rows"
PRODUCT = "products of the rows' units"
SQUARES = "products of the state's units"


class Words(NamedTuple):
    """What a port carries, its unit where the block does not name its numbers, and the frame."""

    meaning: str
    unit: str
    frame: str = NONE


_IQ = Words("an `IqBlock`: complex samples with rate, centre frequency and time of the first [s]", "1")
_BELIEF = Words("mean", STATE, SYSTEM)

WORDS: dict[str, Words] = {
    "acceleration": Words("of each of those in ``state``", "m/s^2", SYSTEM),
    "arrival": Words("when what is measured now will arrive", "s"),
    "arrivals": Words("rows that arrive now, by their age in ticks", SI),
    "assumed_height": Words("height above the ellipsoid that the start assumes", "m"),
    "auxiliary": _IQ,
    "bearing": Words("azimuth and its rate as a measurement, NaN where nothing was measured", "rad, rad/s", SYSTEM),
    "bearing_covariance": Words("of ``bearing``", "products of rad, rad/s"),
    "bias": Words("oscillator's error, as a range rate", "m/s"),
    "common": Words("what most stations' rows have in common", "m/s"),
    "covariance": Words("covariance of ``estimate``, row by row", SQUARES, SYSTEM),
    "differences": Words("rows of one of the sensors that are joined", SI),
    "differences_noise_covariance": Words("their covariance", PRODUCT),
    "direction": Words("azimuth and depression", "rad", "axes of the platform: along the track, across, nadir"),
    "dropped": Words("rows that came too late for the buffer, so far", "1"),
    "emission": Words("an `Emission`: the waveform as a function of time", "1"),
    "error": Words("error of the platform's own position", "m", SYSTEM),
    "estimate": Words("posterior mean, with the measurement of now", STATE, SYSTEM),
    "first": _IQ,
    "inertial": Words("position and velocity of each satellite", STATE, "inertial"),
    "initial_estimate": Words("mean of the prior", STATE, SYSTEM),
    "initial_estimate_10": Words("the same of ten states", "those of the truth", SYSTEM),
    "initial_estimate_9": Words("the same of nine states", "those of the truth", SYSTEM),
    "innovation": Words("measured less predicted", SI),
    "integers": Words("whole cycles added to each wrapped phase", "1"),
    "iq": _IQ,
    "lost": Words("1 where the estimator calls itself lost", "1"),
    "main": _IQ,
    "measured_at": Words("when those in ``arrivals`` were measured", "s"),
    "measurement": Words("one number for each row; NaN: missing", SI),
    "mode": Words("per station: 0 beacon, 1 transponder", "1"),
    "naive_range": Words("range of a target without acceleration", "m"),
    "nees": Words("normalised estimation error squared", "1"),
    "nis": Words("normalised innovation squared; NaN without a row", "1"),
    "nis_dof": Words("its degrees of freedom: rows used", "1"),
    "noise_covariance": Words("covariance R of ``measurement``", PRODUCT),
    "plant": Words("output of the user's own system, six states first", STATE, SYSTEM),
    "platforms": Words("state of each platform, one after the other", STATE, SYSTEM),
    "positions": Words("position at each root that can be a satellite", "m", "inertial"),
    "prediction": Words("mean before the measurement of now", STATE, SYSTEM),
    "prediction_covariance": Words("covariance of ``prediction``", SQUARES, SYSTEM),
    "preview": Words("rows and platform of the first ticks", "SI of the rows, then m, m/s", SYSTEM),
    "prior_position": Words("a measured position", "m", SYSTEM),
    "second": _IQ,
    "stage": Words("the lowest stage attached", "1"),
    "state": Words("position and velocity of each", STATE, SYSTEM),
    "target": Words("true state of the target", STATE, SYSTEM),
    "time": Words("the tick that the estimate is of", "s"),
    "truth": Words("true state, as estimators name it", "those of the state", SYSTEM),
    "weights": Words("probability of each hypothesis", "1"),
    "window": Words("centre of TDOA and FDOA, and half-widths of the search", "s, Hz, s, Hz"),
}

_INERTIAL = Words("of each satellite", "m/s^2", "inertial")
_FIXED = Words("relative to the axes", "m/s^2", "Earth-fixed")
_LAUNCH = Words("relative to the axes", "m/s^2", "launch")
OF_BLOCK: dict[tuple[str, str], Words] = {
    ("AzimuthFilter", "estimate"): Words("azimuth and its rate", "rad, rad/s", SYSTEM),
    ("Constant", "state"): Words("whatever the diagram needs, here the stations", STATE, SYSTEM),
    ("DenseOrbit", "acceleration"): _INERTIAL,
    ("DenseOrbit", "state"): Words("of each satellite", STATE, "Earth-fixed"),
    ("GreatCircle", "acceleration"): _FIXED,
    ("GreatCircle", "state"): Words("of the emitter", STATE, "Earth-fixed"),
    ("Orbit", "acceleration"): _INERTIAL,
    ("Orbit", "state"): Words("of each satellite", STATE, "Earth-fixed"),
    ("OscillatorBias", "state"): Words("bias of all range rates", "m/s"),
    ("RecordedFlight", "acceleration"): _LAUNCH,
    ("RecordedFlight", "state"): Words("of the rocket", STATE, "launch"),
    ("Recorder", "estimate"): Words("any signal, by any name", "as it comes"),
    ("Rocket", "acceleration"): _LAUNCH,
    ("Rocket", "state"): Words("of the rocket", STATE, "launch"),
    ("StraightLine", "acceleration"): _FIXED,
    ("StraightLine", "state"): Words("of the emitter", STATE, "Earth-fixed"),
}


class Port(NamedTuple):
    """A port of a block as the catalogue shows it."""

    direction: str
    name: str
    shape: str
    meaning: str
    unit: str
    frame: str
    feeds: str


def ports_of(one: Standing) -> list[Port]:
    """Return all ports of a block, inputs first.

    Raises
    ------
    KeyError
        For a port that nothing is said of: its name is to be told of in `WORDS`.
    """
    return [*_inputs(one.block), *_outputs(one.block)]


def _inputs(block: EnsembleBlock) -> Iterator[Port]:
    for i in range(block.num_input_ports()):
        name = block.get_input_port(i).get_name()
        words = _words(block, name)
        shape = _shape(block._inputs[name][1]) if name in block._inputs else "one object"
        yield Port("in", name, shape, words.meaning, words.unit, words.frame, "")


def _outputs(block: EnsembleBlock) -> Iterator[Port]:
    for i in range(block.num_output_ports()):
        name = block.get_output_port(i).get_name()
        named = block.components(name)
        words = _words(block, name) if not named or name in WORDS else Words(", ".join(c.name for c in named), "")
        unit = ", ".join(dict.fromkeys(c.unit for c in named)) if named and len(named) <= 10 else words.unit
        through = [
            f"``{block.get_input_port(k).get_name()}``"
            for k in range(block.num_input_ports())
            if block.HasDirectFeedthrough(k, i)
        ]
        shape = _shape(block.output_size(name)) if name in block.output_names() else "one object"
        yield Port("out", name, shape, words.meaning, unit, words.frame, ", ".join(through) or "time, state")


def _words(block: EnsembleBlock, name: str) -> Words:
    found = OF_BLOCK.get((type(block).__name__, name)) or WORDS[name]
    return found._replace(
        meaning=found.meaning.replace("`IqBlock`", "``IqBlock``").replace("`Emission`", "``Emission``")
    )


def _shape(size: tuple[int, int]) -> str:
    trials, numbers = size
    return f"({'trials' if trials == TRIALS else '1'}, {numbers})"
