"""Stations, oscillators, modes and priors as blocks."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic
from quietfix.systems.geometry.visibility import SphericalMask
from quietfix.systems.measurement.range_rate import RangeRate, common_part
from quietfix.systems.plants.joined import Joined
from quietfix.systems.plants.mode_schedule import ModeSchedule
from quietfix.systems.plants.oscillator import BiasLaw, OscillatorBias
from quietfix.systems.recorder import record
from quietfix.systems.sensors.beacon import BeaconStations
from quietfix.systems.sensors.offset_prior import OffsetPrior
from quietfix.systems.signals import Constant, Draw, set_draw

CLOCK = Periodic(0.5)
STATE = np.array([1e4, 5e4, -2e3, 800.0, 300.0, 10.0])
STATIONS = np.array([[0, 0, 0, 0, 0, 0], [2e5, 0, 1e4, 0, 0, 0], [-1e5, 0, 8e4, 0, 0, 0], [6e6, -3e6, 0, 0, 0, 0.0]])
CENTRE = (0.0, -6371e3, 0.0)


def run(trials=3, seed=1, first=0, law=None, windows=(), delays=(0, 0, 0, 0), end=4.0, **options):
    builder = DiagramBuilder()
    target = builder.AddSystem(Constant("target", STATE))
    sites = builder.AddSystem(Constant("sites", STATIONS.ravel()))
    bias = builder.AddSystem(OscillatorBias(law or BiasLaw(100.0), CLOCK, trials))
    mode = builder.AddSystem(ModeSchedule(windows, delays))
    stations = builder.AddSystem(
        BeaconStations(RangeRate(0.03, range(4)), CLOCK, trials, 4, bias_trials=bias.trials, **options)
    )
    for source, port, name in (
        (target, "state", "target"), (sites, "state", "platforms"), (bias, "state", "bias"), (mode, "mode", "mode")
    ):  # fmt: skip
        builder.Connect(source.GetOutputPort(port), stations.GetInputPort(name))
    ports = {name: stations.GetOutputPort(name) for name in ("measurement", "common")}
    recorder = record(builder, ports | {"bias": bias.GetOutputPort("state")}, CLOCK)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    set_draw(diagram, simulator.get_mutable_context(), Draw(seed, first))
    simulator.Initialize()
    simulator.AdvanceTo(end)
    return recorder.result(simulator.get_context())


RATES = RangeRate(0.03, range(4)).predict(STATE, STATIONS)


def test_beacon_and_transponder():
    times, log = run(windows=[(1.0, 2.0)])
    z, common = log["measurement"], log["common"][:, 0, 0]
    locked = (times >= 1.0) & (times < 2.0)
    assert locked.sum() == 2
    np.testing.assert_allclose(z[~locked], np.broadcast_to(RATES + 100.0, z[~locked].shape), atol=0.2)
    np.testing.assert_allclose(z[locked], np.broadcast_to(RATES + RATES[0], z[locked].shape), atol=0.2)
    np.testing.assert_allclose(common, np.where(locked, RATES[0], 100.0), rtol=1e-12)


def test_noise_does_not_depend_on_mode_or_bias():
    """Variants of a scenario differ in what is added, sample by sample, and in nothing else."""
    a = run()[1]["measurement"] - RATES - 100.0
    b = run(law=BiasLaw(88.0, rate=0.1), windows=[(1.0, 2.0)], delays=[0, 0, 0.5, 0])[1]
    added = b["measurement"] - RATES - a
    np.testing.assert_allclose(added[0, :, :], 88.0, atol=1e-9)
    np.testing.assert_allclose(a.std(), 0.03, rtol=0.2)


def test_a_late_station_is_late():
    times, log = run(windows=[(1.0, 2.0)], delays=[0, 0, 0.5, 0])
    added = log["measurement"][:, 0] - RATES
    late = np.isclose(added[:, 2], 100.0, atol=0.3)
    np.testing.assert_array_equal(late, (times < 1.5) | (times >= 2.5))
    np.testing.assert_array_equal(np.isclose(added[:, 1], 100.0, atol=0.3), (times < 1.0) | (times >= 2.0))
    np.testing.assert_allclose(log["common"][times == 1.0], RATES[0])


def test_residual_of_each_station_is_constant_and_of_the_beacon_only():
    times, log = run(trials=400, sigma_residual=2.0, windows=[(1.0, 2.0)])
    added = log["measurement"] - RATES
    beacon = added[(times < 1.0) | (times >= 2.0)] - 100.0
    assert np.ptp(beacon, axis=0).max() < 0.3
    np.testing.assert_allclose(beacon[0].std(), 2.0, rtol=0.08)  # 1600 draws: 1.8 % each
    assert abs(np.corrcoef(beacon[0].T)[0, 1]) < 0.2
    np.testing.assert_allclose(added[times == 1.0], RATES[0], atol=0.2)


def test_hidden_stations_are_nan_and_an_unseen_uplink_silences_the_transponder():
    mask = SphericalMask(0.0, "platform", CENTRE)
    _, log = run(mask=mask)
    assert np.isnan(log["measurement"][..., 3]).all() and np.isfinite(log["measurement"][..., :3]).all()
    times, log = run(mask=mask, windows=[(1.0, 2.0)], uplink=3)
    locked = (times >= 1.0) & (times < 2.0)
    assert np.isnan(log["measurement"][locked]).all() and np.isfinite(log["measurement"][~locked][..., :3]).all()


def test_trials_are_the_same_alone():
    law = BiasLaw(88.0, 0.05, 0.01, 1.0)
    whole, alone = run(trials=5, law=law)[1], run(trials=1, first=3, law=law)[1]
    np.testing.assert_array_equal(whole["measurement"][:, 3:4], alone["measurement"])
    np.testing.assert_array_equal(whole["bias"][:, 3:4], alone["bias"])


def test_the_papers_bias_has_the_papers_statistics_with_eps_per_sample():
    """Figure 4: mean 115.12 and 'variance' 3.65 m/s over 50-300 s; eps once per run would give 3.41."""
    t = np.arange(50.0, 300.01, 0.05)
    law = BiasLaw(88.0, 0.05, 0.01, 1.0)
    eps = np.random.default_rng(0).normal(size=t.size)
    values = np.array([law.value(float(a), np.array(e)) for a, e in zip(t, eps, strict=True)])
    assert values.mean() == pytest.approx(115.12, abs=0.06)
    assert values.std() == pytest.approx(3.65, abs=0.06)
    smooth = np.array([law.value(float(a), np.array(0.0)) for a in t])
    assert smooth.std() == pytest.approx(3.41, abs=0.01)


def test_eps_per_sample_and_per_run():
    sample = run(trials=200, law=BiasLaw(0.0, spread=1.0), end=10.0)[1]["bias"][..., 0]
    once = run(trials=200, law=BiasLaw(0.0, spread=1.0, per="run"), end=10.0)[1]["bias"][..., 0]
    assert np.ptp(once, axis=0).max() == 0.0
    np.testing.assert_allclose([sample.std(), once[0].std()], 1.0, rtol=0.15)
    assert abs(np.corrcoef(sample[1], sample[2])[0, 1]) < 0.25
    assert run(trials=7, law=BiasLaw(3.0))[1]["bias"].shape[1] == 1  # no spread: one for all trials


def test_common_part():
    rates = np.array([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(common_part(rates, np.array([9.0]), np.array([0, 1, 1]), 2), [9.0, 3.0, 3.0])


def test_prior_begins_when_it_is_given():
    builder = DiagramBuilder()
    truth = builder.AddSystem(Constant("t", np.arange(10.0)))
    prior = builder.AddSystem(
        OffsetPrior([50.0] * 3 + [1.0] * 3 + [0.0] * 4, [True] * 9 + [False], (10, 9), 2.0, 600, random_signs=True)
    )
    builder.Connect(truth.GetOutputPort("state"), prior.GetInputPort("truth"))
    recorder = record(builder, {str(n): prior.GetOutputPort(f"initial_estimate_{n}") for n in (10, 9)}, Periodic(1.0))
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    simulator.AdvanceTo(3.0)
    _, log = recorder.result(simulator.get_context())
    assert np.isnan(log["10"][:2]).all() and np.isnan(log["9"][:2]).all()
    error = log["10"][2] - np.arange(10.0)
    np.testing.assert_array_equal(np.abs(error[:, :3]), 50.0)
    assert abs(error[:, 0].mean()) < 50.0 * 4 / math.sqrt(600)
    assert not error[:, 6:9].any() and np.all(log["10"][2][:, 9] == 0.0)
    np.testing.assert_array_equal(log["9"][2], log["10"][2][:, :9])


def test_joined_columns():
    builder = DiagramBuilder()
    one, many = builder.AddSystem(Constant("a", [1.0, 2.0])), builder.AddSystem(Constant("b", [[3.0], [4.0]]))
    joined = builder.AddSystem(Joined({"a": (1, 2), "b": (2, 1)}))
    for port, block in (("a", one), ("b", many)):
        builder.Connect(block.GetOutputPort("state"), joined.GetInputPort(port))
    diagram = builder.Build()
    value = joined.GetOutputPort("state").Eval(joined.GetMyContextFromRoot(diagram.CreateDefaultContext()))
    np.testing.assert_array_equal(value.reshape(2, 3), [[1, 2, 3], [1, 2, 4]])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ModeSchedule([(2.0, 1.0)], [0.0]), "window 0"),
        (lambda: ModeSchedule([(1.0, 3.0), (2.0, 4.0)], [0.0]), "overlap"),
        (lambda: ModeSchedule([], [-1.0]), "delays"),
        (lambda: BiasLaw(1.0, spread=-1.0), "spread"),
        (lambda: BiasLaw(1.0, per="day"), "per"),
        (lambda: RangeRate(0.0, [0]), "sigma_range_rate"),
        (lambda: RangeRate(1.0, [0, 0]), "twice"),
        (lambda: RangeRate(1.0, [0], bias=4), "bias"),
        (lambda: BeaconStations(RangeRate(1.0, [0]), CLOCK, 2, 1, uplink=3), "uplink"),
        (lambda: OffsetPrior([1.0], [True], (2,), 0.0, 1), "sizes"),
    ],
)
def test_what_is_not_allowed(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_biased_model_is_differentiated_with_its_bias():
    model = RangeRate(0.03, range(4), bias=9)
    state = np.concatenate([STATE, [1.0, 2.0, 3.0, 77.0]])
    jacobian = model.jacobian(state, STATIONS)
    np.testing.assert_allclose(model.predict(state, STATIONS), RATES + 77.0)
    for j, step in enumerate([10.0] * 3 + [1.0] * 7):
        move = np.zeros(10)
        move[j] = step
        numeric = (model.predict(state + move, STATIONS) - model.predict(state - move, STATIONS)) / (2 * step)
        np.testing.assert_allclose(jacobian[:, j], numeric, rtol=1e-5, atol=1e-9)
