"""The gate for arrival times."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import geodetic_state
from quietfix.systems.estimators.arrival_gate import KEPT, REFUSED, ArrivalGate, without_receivers
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.fixes.snapshot import snapshot_fix, starts_around
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.recorder import record
from quietfix.systems.sensors.recorded import RecordedMeasurements, Recording
from quietfix.systems.starts.snapshot_start import SnapshotStart

C = SPEED_OF_LIGHT
TDOA = Tdoa(40.0 / C, (1, 2, 3, 4), correlated=True)
MODEL = Stack([TDOA, Altitude(150.0)])
R = MODEL.noise_covariance()
FAULT = 3000.0 / C
# five receivers around the target: every one of them can be missed
STATIONS = geodetic_state(
    np.radians([47.3, 47.9, 48.6, 48.5, 47.5]), np.radians([8.9, 9.9, 9.5, 8.2, 8.1]), 600.0, 0.0, 0.0
)
TARGET = geodetic_state(np.radians(48.0), np.radians(9.0), 10e3, np.radians(70.0), 230.0).reshape(6)


def noisy(target, rng, trials):
    root = np.linalg.cholesky(R)
    return MODEL.predict(target, STATIONS) + np.einsum("ij,tj->ti", root, rng.normal(size=(trials, 5)))


def with_fault(measurement, receiver, fault=FAULT):
    """Add an error to the arrival time at one receiver: one difference, or for receiver 0 all of them."""
    spoiled = measurement.copy()
    if receiver == 0:
        spoiled[..., :4] -= fault
    else:
        spoiled[..., receiver - 1] += fault
    return spoiled


def judge(measurement, prediction=None, covariance=None, platforms=STATIONS, port_noise=None, **options):
    """Return what the gate makes of a measurement (trials, 5)."""
    trials = len(measurement)
    gate = ArrivalGate(MODEL, TDOA, trials, 5, "altitude", feedback=0 if prediction is None else 6, **options)
    context = gate.CreateDefaultContext()
    inputs = {"measurement": measurement, "platforms": platforms}
    if prediction is not None:
        inputs |= {"prediction": prediction, "prediction_covariance": covariance}
    for name, value in inputs.items():
        gate.GetInputPort(name).FixValue(context, np.ravel(value))
    if options.get("noise_port"):
        gate.GetInputPort("noise_covariance").FixValue(context, np.ravel(port_noise))
    names = ("measurement", "noise_covariance", "excluded")
    rows, noise, excluded = (gate.GetOutputPort(name).Eval(context) for name in names)
    return rows.reshape(trials, 5), noise.reshape(trials, 5, 5), excluded


def fix_of(measurement, noise=R):
    platforms = np.broadcast_to(STATIONS, (len(measurement), 5, 6))
    return snapshot_fix(measurement, platforms, MODEL, noise, starts_around(platforms, np.full(len(measurement), 1e4)))


# ------------------------------------------------------------------------------- leaving out the reference


def test_a_huge_common_variance_is_differencing_against_another_receiver():
    _, noise = without_receivers(MODEL, TDOA)
    jacobian = TDOA.jacobian(TARGET, STATIONS)[:, :3]
    information = jacobian.T @ np.linalg.inv(noise[1][:4, :4]) @ jacobian
    other = Tdoa(40.0 / C, (2, 3, 4), reference=1, correlated=True)
    rows = other.jacobian(TARGET, STATIONS)[:, :3]
    want = rows.T @ np.linalg.inv(other.noise_covariance()) @ rows
    # what is left of receiver 0 is 1e-6 of a weight, spread over directions that differ by 1e2 in information
    np.testing.assert_allclose(information, want, atol=1e-5 * np.linalg.norm(want))
    # the same by the formula: R_S^-1 = (I - S / (s^2 + n S) 1 1^T) / s^2
    s2 = (40.0 / C) ** 2 / 2
    huge = noise[1][0, 1]
    formula = (np.eye(4) - huge / (s2 + 4 * huge) * np.ones((4, 4))) / s2
    np.testing.assert_allclose(np.linalg.inv(noise[1][:4, :4]) * s2, formula * s2, atol=1e-9)


def test_cases_have_the_rows_and_the_noise_they_should():
    dropped, noise = without_receivers(MODEL, TDOA)
    np.testing.assert_array_equal(noise[[0, 2, 3, 4, 5]], np.tile(R, (5, 1, 1)))
    want = np.zeros((6, 5), dtype=bool)
    want[[2, 3, 4, 5], [0, 1, 2, 3]] = True
    np.testing.assert_array_equal(dropped, want)


@pytest.mark.parametrize("receiver", range(5))
def test_a_fix_without_a_receiver_is_the_fix_of_the_others(receiver):
    measurement = noisy(TARGET, np.random.default_rng(1), 20)
    dropped, noise = without_receivers(MODEL, TDOA)
    got = fix_of(np.where(dropped[1 + receiver], np.nan, with_fault(measurement, receiver)), noise[1 + receiver])
    kept = [i for i in range(5) if i != receiver]
    model = Stack([Tdoa(40.0 / C, kept[1:], kept[0], correlated=True), Altitude(150.0)])
    arrival = np.concatenate([np.zeros((20, 1)), measurement[:, :4]], axis=1)
    rows = np.concatenate([arrival[:, kept[1:]] - arrival[:, kept[:1]], measurement[:, 4:]], axis=1)
    platforms = np.broadcast_to(STATIONS, (20, 5, 6))
    starts = starts_around(platforms, np.full(20, 1e4))
    want = snapshot_fix(rows, platforms, model, model.noise_covariance(), starts)
    # fixes good to 100 m; 3 km times 1e-6 of a weight is a few centimetres
    np.testing.assert_allclose(got.position, want.position, atol=0.1)
    np.testing.assert_allclose(got.covariance, want.covariance, rtol=1e-3, atol=1.0)


# ------------------------------------------------------------------------------------------------ decisions


def test_sound_measurements_pass_untouched():
    measurement = noisy(TARGET, np.random.default_rng(2), 1500)
    rows, noise, excluded = judge(measurement, false_alarm=1e-2)
    wrong = excluded != KEPT
    # 15 false alarms are expected: 3 standard deviations are 12
    assert 3 < np.count_nonzero(wrong) < 27
    np.testing.assert_array_equal(rows[~wrong], measurement[~wrong])
    np.testing.assert_array_equal(noise[~wrong], np.broadcast_to(R, (np.count_nonzero(~wrong), 5, 5)))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("receiver", range(5))
@pytest.mark.parametrize("known", [False, True])
def test_the_receiver_with_an_error_of_3_km_is_left_out(receiver, sign, known):
    rng = np.random.default_rng(3)
    measurement = noisy(TARGET, rng, 200)
    prediction = covariance = None
    if known:
        covariance = np.tile(np.diag([100.0**2] * 3 + [100.0] * 3), (200, 1, 1))
        prediction = TARGET + rng.normal(size=(200, 6)) * np.sqrt(np.diagonal(covariance[0]))
    rows, noise, excluded = judge(with_fault(measurement, receiver, sign * FAULT), prediction, covariance)
    sound, found = fix_of(measurement), excluded == receiver
    assert not np.any((excluded != receiver) & (excluded != REFUSED))
    # alone, another receiver explains it as well in some draws; the prediction decides
    assert found.mean() > (0.99 if known else 0.7)
    got = fix_of(rows[found], noise[found])
    spread = np.sqrt(np.trace(got.covariance, axis1=1, axis2=2))
    moved = np.linalg.norm(got.position - sound.position[found], axis=-1)
    # the fix without one receiver differs from that with it by less than its own uncertainty
    assert np.all(moved < 4 * spread) and np.median(moved) < 100
    spoiled = fix_of(with_fault(measurement, receiver, sign * FAULT))
    assert np.nanmedian(np.linalg.norm(spoiled.position - sound.position, axis=-1)) > 700


def test_noise_that_comes_with_the_measurement_is_that_of_a_model_which_has_it():
    """Half of the trials are believed three times better than they are: judged as by a model of that sigma."""
    rng = np.random.default_rng(21)
    measurement = with_fault(noisy(TARGET, rng, 40), 2, 0.1 * FAULT)
    sharp_tdoa = Tdoa(TDOA.sigma / 3, TDOA.receivers, correlated=True)
    sharp = Stack([sharp_tdoa, MODEL.models[1]])
    mixed = np.where((np.arange(40) % 2)[:, None, None], R, sharp.noise_covariance())
    together = judge(measurement, port_noise=mixed, noise_port=True)
    plain = judge(measurement)
    gate = ArrivalGate(sharp, sharp_tdoa, 40, 5, "altitude", feedback=0)
    context = gate.CreateDefaultContext()
    for name, value in {"measurement": measurement, "platforms": STATIONS}.items():
        gate.GetInputPort(name).FixValue(context, np.ravel(value))
    strict = gate.GetOutputPort("excluded").Eval(context)
    assert np.any(plain[2] != strict)
    np.testing.assert_array_equal(together[2], np.where(np.arange(40) % 2, plain[2], strict))


def test_where_two_receivers_may_be_the_bad_one_none_is_left_out():
    rng = np.random.default_rng(10)
    latitude, longitude = np.radians(rng.uniform(47, 49, (500, 5))), np.radians(rng.uniform(8, 11, (500, 5)))
    platforms = geodetic_state(latitude, longitude, 500.0, 0.0, 0.0)
    receiver = rng.integers(5, size=500)
    measurement = MODEL.predict(TARGET, platforms) + np.einsum(
        "ij,tj->ti", np.linalg.cholesky(R), rng.normal(size=(500, 5))
    )
    measurement = np.array([with_fault(row, i) for row, i in zip(measurement, receiver, strict=True)])
    _, _, excluded = judge(measurement, platforms=platforms, platform_trials=500)
    decided = excluded >= 0
    assert np.mean(excluded == REFUSED) > 0.1
    assert decided.mean() > 0.7
    # odds of 20 to 1 are asked for; the lowest cost alone would be wrong in 6 % of them
    assert np.mean(excluded[decided] != receiver[decided]) < 0.02


@pytest.mark.parametrize("receiver", range(4))
def test_four_receivers_show_an_error_but_not_whose(receiver):
    measurement = noisy(TARGET, np.random.default_rng(11), 50)
    measurement[:, 3] = np.nan
    _, _, sound = judge(measurement)
    rows, _, excluded = judge(with_fault(measurement, receiver))
    assert np.all(sound == KEPT)
    assert np.all(excluded == REFUSED) and np.isnan(rows).all()


def test_two_bad_receivers_are_refused():
    measurement = noisy(TARGET, np.random.default_rng(4), 100)
    rows, _, excluded = judge(with_fault(with_fault(measurement, 1), 3, -1.7 * FAULT))
    assert np.mean(excluded == REFUSED) > 0.95
    assert np.isnan(rows[excluded == REFUSED]).all()


def test_a_wrong_prediction_does_not_refuse_a_sound_measurement():
    measurement = noisy(TARGET, np.random.default_rng(5), 100)
    prediction = np.tile(TARGET, (100, 1)) + np.array([30e3, -20e3, 10e3, 0, 0, 0])
    _, _, excluded = judge(measurement, prediction, np.tile(np.diag([50.0**2] * 6), (100, 1, 1)))
    assert np.all(excluded == KEPT)


def test_a_manoeuvre_within_the_slack_costs_no_receiver():
    measurement = noisy(TARGET, np.random.default_rng(6), 200)
    prediction = np.tile(TARGET, (200, 1)) + 2.5 * np.array([100.0, -100.0, 100.0, 0, 0, 0])
    covariance = np.tile(np.diag([100.0**2] * 6), (200, 1, 1))
    _, _, believed = judge(measurement, prediction, covariance, slack=1.0)
    _, _, excluded = judge(measurement, prediction, covariance, slack=3.0)
    assert np.any(believed != KEPT)  # taken at its word, the prediction makes some receivers look bad
    assert np.all(excluded == KEPT)


def test_trials_do_not_touch_each_other():
    rng = np.random.default_rng(7)
    measurement = noisy(TARGET, rng, 6)
    measurement[1] = np.nan
    measurement[2] = with_fault(measurement[2], 0)
    measurement[3, 1] = np.nan
    prediction = np.tile(TARGET, (6, 1))
    covariance = np.tile(np.diag([100.0**2] * 6), (6, 1, 1))
    prediction[4] = np.nan  # has not begun
    whole = judge(measurement, prediction, covariance)
    assert list(whole[2]) == [KEPT, KEPT, 0, KEPT, KEPT, KEPT]
    for trial in range(6):
        alone = judge(measurement[[trial]], prediction[[trial]], covariance[[trial]])
        for part, same in zip(alone, whole, strict=True):
            np.testing.assert_array_equal(part[0], same[trial])
    _, _, nothing = judge(np.full((3, 5), np.nan), prediction[:3], covariance[:3])
    assert np.all(nothing == KEPT)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tdoa": Tdoa(1e-7, (1, 2, 3, 4))}, "correlated"),
        ({"tdoa": Tdoa(1e-7, (1, 2, 3, 5), correlated=True)}, "tdoa_50"),
        ({"height": "depth"}, "depth"),
        ({"false_alarm": 0.0}, "false_alarm 0.0"),
        ({"slack": -1.0}, "slack"),
        ({"trials": 0}, "trials"),
    ],
)
def test_arguments_are_checked(change, message):
    arguments = {"model": MODEL, "tdoa": TDOA, "trials": 1, "platforms": 5, "height": "altitude"} | change
    with pytest.raises(ValueError, match=message):
        ArrivalGate(**arguments)


# ------------------------------------------------------------------------------------------ in front of a filter


def diagram_of(recordings):
    builder = DiagramBuilder()
    recorded = builder.AddSystem(RecordedMeasurements(recordings))
    trials, names = recorded.trials, MODEL.names
    gate = builder.AddSystem(ArrivalGate(MODEL, TDOA, trials, 5, "altitude"))
    motion = WhiteNoiseAcceleration(1.0)
    filters = {}
    for name, gated in (("gated", True), ("bare", False)):
        start = SnapshotStart(MODEL, names, 200.0, "altitude", noise_port=gated)
        wiring = Wiring(trials, names, recorded.clock, 5, noise_port=gated)
        filters[name] = builder.AddSystem(Iekf().make(name, MODEL, motion, start, wiring))
    source = {name: recorded.GetOutputPort(name) for name in ("measurement", "platforms")}
    for block in (gate, *filters.values()):
        builder.Connect(source["platforms"], block.GetInputPort("platforms"))
    for block in (gate, filters["bare"]):
        builder.Connect(source["measurement"], block.GetInputPort("measurement"))
    for port, inputs in (
        ("measurement", ["measurement"]),
        ("noise_covariance", ["noise_covariance", "start_noise_covariance"]),
    ):
        for name in inputs:
            builder.Connect(gate.GetOutputPort(port), filters["gated"].GetInputPort(name))
    for port in ("prediction", "prediction_covariance"):
        builder.Connect(filters["gated"].GetOutputPort(port), gate.GetInputPort(port))
    ports = {name: block.GetOutputPort("estimate") for name, block in filters.items()}
    ports |= {"excluded": gate.GetOutputPort("excluded"), "covariance": filters["gated"].GetOutputPort("covariance")}
    recorder = record(builder, ports, recorded.clock)
    return builder.Build(), recorded, recorder


def test_a_track_survives_an_error_at_any_receiver():
    times = np.cumsum([0.0, 4.0, 1.5, 7.0, 3.0, 5.0, 2.0, 6.0])
    at, trials = 5, 20
    rng = np.random.default_rng(8)
    truth = TARGET[:3] + times[:, None] * TARGET[3:]
    states = np.concatenate([truth, np.tile(TARGET[3:], (8, 1))], axis=1)
    sound = np.stack([noisy(state, rng, trials) for state in states])
    recordings = [Recording(times, sound, STATIONS)]
    for receiver in range(5):
        spoiled = sound.copy()
        spoiled[at] = with_fault(sound[at], receiver)
        recordings.append(Recording(times, spoiled, STATIONS))
    diagram, recorded, recorder = diagram_of(recordings)
    results = []
    for track in range(6):
        context = diagram.CreateDefaultContext()
        end = recorded.select(context, track)
        simulator = Simulator(diagram, context)
        simulator.Initialize()
        simulator.AdvanceTo(end)
        results.append(recorder.result(context)[1])
    clean = results[0]
    assert np.mean(clean["excluded"] == KEPT) > 0.98
    sigma = np.sqrt(np.trace(clean["covariance"].reshape(8, trials, 6, 6)[..., :3, :3], axis1=-2, axis2=-1))
    for receiver in range(5):
        signals = results[1 + receiver]
        assert np.mean(signals["excluded"][at] == receiver) >= 0.9
        moved, bare = (np.linalg.norm((signals[name] - clean[name])[..., :3], axis=-1) for name in ("gated", "bare"))
        np.testing.assert_array_equal(moved[:at], 0.0)
        # less than the filter's own uncertainty with all five receivers; without the gate several times that
        assert np.all(moved[at:] < 2 * sigma[at:])
        assert np.median(bare[at]) > 200 and np.median(bare[at]) > 10 * np.median(moved[at])
