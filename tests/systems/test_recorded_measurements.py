"""Recorded measurements behind the ports of a sensor."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Times
from quietfix.systems.earth.geodetic import geodetic_state
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.geometry.refractivity import mean_refractivity
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.plants.emitter import StraightLine
from quietfix.systems.recorder import record
from quietfix.systems.sensors.recorded import RecordedMeasurements, Recording
from quietfix.systems.sensors.sensor import Sensor
from quietfix.systems.signals import Constant, Draw, set_draw
from quietfix.systems.starts.start import GivenStart

RNG = np.random.default_rng(4)
STATIONS = geodetic_state(
    np.radians([47.0, 47.9, 48.3, 47.4, 48.8]), np.radians([8.0, 9.5, 8.3, 10.2, 9.1]), 500.0, 0.0, 0.0
)
TARGET = geodetic_state(np.radians(48.0), np.radians(9.0), 10e3, np.radians(70.0), 230.0).reshape(6)
MODEL = Stack([Tdoa(1e-7, (1, 2, 3, 4), correlated=True), Altitude(100.0)])


def recording(times, rows=2, trials=1, platforms=3, noise=False):
    n = len(times)
    r = np.tile(np.eye(rows), (n, trials, 1, 1)) * RNG.uniform(1, 2, (n, 1, 1, 1)) if noise else None
    return Recording(times, RNG.normal(size=(n, trials, rows)), RNG.normal(size=(n, 1, platforms, 6)), r)


def play(diagram, recorded, recorder, track):
    context = diagram.CreateDefaultContext()
    end = recorded.select(context, track)
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(end)
    return recorder.result(context)


def recorded_only(recordings):
    builder = DiagramBuilder()
    recorded = builder.AddSystem(RecordedMeasurements(recordings))
    ports = {name: recorded.GetOutputPort(name) for name in recorded.output_names()}
    recorder = record(builder, ports, recorded.clock)
    return builder.Build(), recorded, recorder


# ----------------------------------------------------------------------------------------------------- ports


def test_ports_say_what_was_recorded_and_nothing_between():
    one, other = recording([1.0, 2.5, 7.0], trials=2, noise=True), recording([0.5, 2.5], trials=2, noise=True)
    block = RecordedMeasurements([one, other])
    context = block.CreateDefaultContext()
    sizes = {name: block.output_size(name) for name in block.output_names()}
    assert sizes == {"measurement": (2, 2), "platforms": (1, 18), "noise_covariance": (2, 4)}
    for track, source in enumerate((one, other)):
        block.select(context, track)
        for time in (0.5, 1.0, 2.5, 7.0, 3.0, 99.0):
            context.SetTime(time)
            got = {name: block.GetOutputPort(name).Eval(context) for name in sizes}
            if time in source.times:
                k = list(source.times).index(time)
                for name, value in got.items():
                    np.testing.assert_array_equal(value, getattr(source, name)[k].ravel())
            else:
                assert all(np.isnan(value).all() for value in got.values())


def test_platforms_that_stand_still_are_given_once():
    block = Recording([0.0, 3.0], np.zeros((2, 4)), STATIONS)
    assert block.platforms.shape == (2, 1, 5, 6)
    np.testing.assert_array_equal(block.platforms[1, 0], STATIONS)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0, 1.0], np.zeros((3, 2)), np.zeros((2, 6))), "measurement"),
        (([0.0, 1.0], np.zeros(2), np.zeros((2, 6))), "measurement"),
        (([0.0, 1.0], np.zeros((2, 2)), np.zeros((2, 5))), "platforms"),
        (([0.0, 1.0], np.zeros((2, 3, 2)), np.zeros((2, 2, 4, 6))), "platforms"),
        (([0.0, 1.0], np.zeros((2, 2)), np.zeros((4, 6)), np.zeros((2, 3, 3))), "noise_covariance"),
        (([1.0, 1.0], np.zeros((2, 2)), np.zeros((4, 6))), "increase strictly"),
    ],
)
def test_a_recording_checks_its_shapes(arguments, message):
    with pytest.raises(ValueError, match=message):
        Recording(*arguments)


def test_recordings_must_fit_together():
    with pytest.raises(ValueError, match="no recordings"):
        RecordedMeasurements([])
    with pytest.raises(ValueError, match="must agree"):
        RecordedMeasurements([recording([0.0]), recording([0.0], rows=3)])
    block = RecordedMeasurements([recording([0.0])])
    with pytest.raises(ValueError, match="track 1 is not allowed; 0 to 0"):
        block.select(block.CreateDefaultContext(), 1)


# ------------------------------------------------------------------------------------- one diagram, many runs


def test_one_diagram_plays_all_recordings_each_from_its_first_to_its_last_sample():
    recordings = [recording(np.sort(RNG.uniform(0, 100, n))) for n in (6, 1, 4, 3)]
    diagram, recorded, recorder = recorded_only(recordings)
    union = np.unique(np.concatenate([r.times for r in recordings]))
    for track in (0, 2, 1, 3, 0):
        times, signals = play(diagram, recorded, recorder, track)
        own = recordings[track].times
        # ticks of the others fire in between, and none before the start
        np.testing.assert_array_equal(times, union[(union >= own[0]) & (union <= own[-1])])
        mine = np.isin(times, own)
        np.testing.assert_array_equal(signals["measurement"][mine], recordings[track].measurement)
        assert np.isnan(signals["measurement"][~mine]).all()


def test_samples_that_differ_by_rounding_are_one_tick():
    recordings = [recording([1.0, 1.3]), recording([np.nextafter(1.3, 2.0), 2.0])]
    diagram, recorded, recorder = recorded_only(recordings)
    assert recorded.clock.ticks(9.0).size == 3
    for track in (0, 1):
        _, signals = play(diagram, recorded, recorder, track)
        assert np.isfinite(signals["measurement"]).all(axis=(1, 2)).sum() == 2


# --------------------------------------------------------------------------- in the place of a simulated sensor


def add_filter(builder, source, clock, trials, noise_port):
    start = GivenStart(np.add(TARGET, [900, -700, 400, 20, -10, 5]), np.diag([1e6] * 3 + [400.0] * 3))
    wiring = Wiring(trials, MODEL.names, clock, len(STATIONS), noise_port=noise_port)
    block = builder.AddSystem(Iekf().make("iekf", MODEL, WhiteNoiseAcceleration(0.1), start, wiring))
    for port in ("measurement", "platforms", *(["noise_covariance"] if noise_port else [])):
        builder.Connect(source[port], block.GetInputPort(port))
    return {name: block.GetOutputPort(name) for name in ("estimate", "covariance", "nis")}


@pytest.mark.parametrize("noise_port", [False, True])
def test_it_stands_in_for_the_sensor_it_was_recorded_from(noise_port):
    trials, clock = 3, Times([0.0, 1.0, 2.5, 2.6, 9.0])
    builder = DiagramBuilder()
    target = builder.AddSystem(StraightLine(TARGET, name="aircraft"))
    stations = builder.AddSystem(Constant("stations", STATIONS.ravel()))
    sensor = builder.AddSystem(Sensor(MODEL, clock, trials, len(STATIONS)))
    builder.Connect(target.GetOutputPort("state"), sensor.GetInputPort("target"))
    builder.Connect(stations.GetOutputPort("state"), sensor.GetInputPort("platforms"))
    source = {"measurement": sensor.GetOutputPort("measurement"), "platforms": stations.GetOutputPort("state")}
    outputs = add_filter(builder, source, clock, trials, noise_port=False)
    recorder = record(builder, {**source, **outputs}, clock)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(seed=5))
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(9.0)
    times, simulated = recorder.result(context)
    error = np.linalg.norm(simulated["estimate"][-1, :, :3] - TARGET[:3] - 9 * TARGET[3:], axis=-1)
    assert error.max() < 200  # it tracks: the start was 1200 m off, the noise is 30 m

    r = np.tile(MODEL.noise_covariance(), (len(times), 1, 1)) if noise_port else None
    tape = Recording(times, simulated["measurement"], simulated["platforms"].reshape(len(times), 1, -1, 6), r)
    builder = DiagramBuilder()
    recorded = builder.AddSystem(RecordedMeasurements([recording([4.0], 5, trials, 5, noise_port), tape]))
    source = {name: recorded.GetOutputPort(name) for name in recorded.output_names()}
    outputs = add_filter(builder, source, recorded.clock, trials, noise_port)
    recorder = record(builder, outputs, recorded.clock)
    stamps, replayed = play(builder.Build(), recorded, recorder, 1)
    mine = stamps != 4.0  # the other recording's sample makes a tick without a measurement
    np.testing.assert_array_equal(stamps[mine], times)
    assert np.isnan(replayed["nis"][~mine]).all()
    for name in outputs:
        # one prediction over 6.4 s or two over 1.4 s and 5 s: rounding of 6e6 m over 1e-7 s
        np.testing.assert_allclose(replayed[name][mine], simulated[name], rtol=1e-7, atol=1e-5)


# ------------------------------------------------------------------------------------------------------- air


@pytest.mark.parametrize(("lower", "upper"), [(0.0, 10e3), (10e3, 500.0), (300.0, 301.0), (2e3, 2e3)])
def test_mean_refractivity_is_the_mean_along_the_path(lower, upper):
    heights = np.linspace(lower, upper, 20001)
    want = np.mean((315e-6 * np.exp(-heights / 7350))[:-1] + np.diff(315e-6 * np.exp(-heights / 7350)) / 2)
    # the trapezoidal rule with 20000 steps is exact to 1e-9 here
    np.testing.assert_allclose(mean_refractivity(lower, upper), want, rtol=1e-8)
