"""The sensor block: exact value plus noise of the model's covariance, NaN where nothing is heard."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic, Times
from quietfix.systems.earth.geodetic import vertical
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.recorder import record
from quietfix.systems.sensors.sensor import Sensor
from quietfix.systems.signals import Constant, Draw, set_draw
from tests.laws.cases import GEOMETRIES, MEASUREMENTS, PASS, PLACES, phase, place, satellites, six, tdoa
from tests.laws.rig import Linear

TARGET = place(*PLACES["(0,300)"])
SATELLITES = satellites(PASS / 2)


def simulate(model, trials, end, draw=None, clock=None, target=TARGET, platforms=SATELLITES, log=None, **options):
    """Return times and what the sensor said, shape (samples, trials, rows)."""
    builder = DiagramBuilder()
    target, platforms = np.atleast_2d(target), np.reshape(platforms, (-1, platforms.shape[-2], 6))
    clock = clock or Periodic(1.0)
    sensor = builder.AddSystem(
        Sensor(
            model,
            clock,
            trials,
            platforms.shape[1],
            target_trials=len(target),
            platform_trials=len(platforms),
            **options,
        )
    )
    for port, value in (("target", target), ("platforms", platforms.reshape(len(platforms), -1))):
        builder.Connect(
            builder.AddSystem(Constant(port, value)).GetOutputPort("state"),
            sensor.GetInputPort(port),
        )
    recorder = record(builder, {"z": sensor.GetOutputPort("measurement")}, log or clock)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    set_draw(diagram, simulator.get_mutable_context(), draw or Draw(5))
    simulator.Initialize()
    simulator.AdvanceTo(end)
    times, values = recorder.result(simulator.get_context())
    return times, values["z"]


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_noise_has_the_models_covariance(name):
    """20 000 draws: an element of the normalised covariance scatters by at most sqrt(2/N) = 0.01; five of these."""
    model, geometry = MEASUREMENTS[name]
    scene = GEOMETRIES[geometry]
    trials, samples = 1000, 20
    _, z = simulate(model, trials, samples - 1.0, target=scene.targets[0], platforms=scene.platforms[0])
    exact = model.predict(scene.targets[:1], scene.platforms)
    noise = model.residual(z, exact).reshape(-1, model.size) / model.sigmas
    n = len(noise)
    assert n == trials * samples
    expected = model.noise_covariance() / np.outer(model.sigmas, model.sigmas)
    sample = noise.T @ noise / n
    assert np.abs(noise.mean(axis=0)).max() < 5 / np.sqrt(n)
    assert np.abs(sample - expected).max() < 5 * np.sqrt(2 / n)
    # and it is white: an epoch says nothing about the next
    series = noise.reshape(samples, trials, model.size)
    assert np.abs((series[1:] * series[:-1]).mean(axis=(0, 1))).max() < 5 / np.sqrt(n - trials)


@pytest.mark.parametrize("correlated", [False, True])
def test_differences_share_the_noise_of_the_reference(correlated):
    """Diagonal sigma^2 either way; half of it between rows when correlated."""
    model = tdoa(correlated=correlated)
    _, z = simulate(model, 2000, 19.0)
    noise = ((z - model.predict(TARGET, SATELLITES)) / 20e-9).reshape(-1, 2)
    sample = noise.T @ noise / len(noise)
    np.testing.assert_allclose(np.diag(sample), 1.0, atol=5 * np.sqrt(2 / len(noise)))
    np.testing.assert_allclose(sample[0, 1], 0.5 if correlated else 0.0, atol=5 / np.sqrt(len(noise)))


def test_a_singular_covariance_is_drawn_as_it_is():
    model = Linear(np.eye(2, 6), [[4.0, 4.0], [4.0, 4.0]])
    _, z = simulate(model, 500, 3.0)
    noise = z - model.predict(TARGET, None)
    np.testing.assert_allclose(noise[..., 0], noise[..., 1], atol=1e-8)
    assert abs(noise[..., 0].std() - 2.0) < 0.2


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_a_trial_alone_is_bit_equal(name):
    """Also where rows are correlated: what mixes them must not depend on the size of the batch."""
    model, geometry = MEASUREMENTS[name]
    scene = {"target": GEOMETRIES[geometry].targets[0], "platforms": GEOMETRIES[geometry].platforms[0]}
    whole = simulate(model, 100, 5.0, **scene)[1]
    np.testing.assert_array_equal(simulate(model, 1, 5.0, Draw(5, 37), **scene)[1][:, 0], whole[:, 37])
    np.testing.assert_array_equal(simulate(model, 7, 5.0, Draw(5, 33), **scene)[1], whole[:, 33:40])


def test_a_dense_covariance_is_bit_equal_too():
    a = np.random.default_rng(3).normal(size=(9, 9))
    model = Linear(a[:, :6], a @ a.T + np.eye(9))
    whole = simulate(model, 100, 5.0)[1]
    np.testing.assert_array_equal(simulate(model, 1, 5.0, Draw(5, 37))[1][:, 0], whole[:, 37])
    np.testing.assert_array_equal(simulate(model, 7, 5.0, Draw(5, 33))[1], whole[:, 33:40])


def test_noise_is_a_function_of_seed_and_name():
    whole = simulate(six(), 100, 5.0)[1]
    np.testing.assert_array_equal(simulate(six(), 100, 5.0)[1], whole)
    assert np.all(simulate(six(), 100, 5.0, Draw(6))[1] != whole)
    assert np.all(simulate(six(), 100, 5.0, name="other")[1] != whole)


def test_trials_of_truth_and_platforms():
    """Truth per trial, platforms per trial, both or neither: each trial sees its own."""
    targets = place(*np.array(list(PLACES.values())[:3]).T)
    carriers = np.stack([satellites(t) for t in (70.0, 75.0, 80.0)])
    for target in (TARGET, targets):
        for platforms in (SATELLITES, carriers):
            z = simulate(tdoa(), 3, 0.0, target=target, platforms=platforms)[1][0]
            noise = simulate(tdoa(), 3, 0.0)[1][0] - tdoa().predict(TARGET, SATELLITES)
            exact = tdoa().predict(np.broadcast_to(target, (3, 6)), np.broadcast_to(platforms, (3, 3, 6)))
            np.testing.assert_allclose(z, exact + noise, rtol=0, atol=1e-15)
    with pytest.raises(ValueError, match="target has 2 trials; 1 or 3"):
        Sensor(tdoa(), Periodic(1.0), 3, 3, target_trials=2)


def test_off_its_clock_it_says_nothing():
    times, z = simulate(six(), 2, 3.0, clock=Times([0.5, 1.5]), log=Periodic(0.25))
    said = np.isin(times, [0.5, 1.5])
    assert said.sum() == 2
    assert np.isfinite(z[said]).all() and np.isnan(z[~said]).all()


def test_wrapped_phases_are_reported_in_their_interval():
    z = simulate(phase(wrapped=True), 100, 5.0)[1]
    assert z.min() >= -np.pi and z.max() < np.pi
    plain = simulate(phase(), 100, 5.0)[1]
    np.testing.assert_allclose(np.exp(1j * z), np.exp(1j * plain), atol=1e-12)  # the same noise


# ----------------------------------------------------------------------------------------------------- horizon


def test_a_platform_below_the_horizon_takes_its_rows():
    """Satellite 2 lower than the mask: TDOA and FDOA against it are gone, the others are as without a mask."""
    elevation = ElevationMask().elevation(TARGET, SATELLITES)
    order = np.argsort(elevation)
    assert order[0] in (1, 2)
    mask = ElevationMask((elevation[order[0]] + elevation[order[1]]) / 2)
    z, plain = simulate(six(), 5, 3.0, mask=mask)[1], simulate(six(), 5, 3.0)[1]
    gone = six().platforms_used(3)[:, order[0]]
    assert gone.sum() == 2
    assert np.isnan(z[..., gone]).all()
    np.testing.assert_array_equal(z[..., ~gone], plain[..., ~gone])
    everything = ElevationMask(np.radians(89.0))
    assert np.isnan(simulate(six(), 5, 0.0, mask=everything)[1]).all()


def test_only_the_trial_that_is_hidden():
    targets = np.stack([TARGET, place(3000e3, 3000e3)])
    assert not ElevationMask().visible(targets, SATELLITES[None])[1].any()
    z = simulate(six(), 2, 0.0, target=targets, mask=ElevationMask())[1][0]
    assert np.isfinite(z[0]).all() and np.isnan(z[1]).all()


def test_elevation():
    """Overhead is 90 degrees although rounding makes the sine exceed 1; the antipode is -90."""
    below = place(0.0, 0.0, height=0.0)
    up = below[:3] / np.linalg.norm(below[:3])
    mask = ElevationMask(np.radians(80.0))
    rng = np.random.default_rng(0)
    latitudes = place(*rng.uniform(-1000e3, 1000e3, (2, 500)), height=0.0)
    normal, _ = vertical(latitudes[:, :3])
    above = np.concatenate([latitudes[:, :3] + 700e3 * normal, np.zeros((500, 3))], axis=-1)[:, None]
    np.testing.assert_allclose(mask.elevation(latitudes, above), np.pi / 2, atol=1e-7)
    assert mask.visible(latitudes, above).all()
    antipode = np.concatenate([-7e6 * up, np.zeros(3)])[None]
    np.testing.assert_allclose(mask.elevation(below, antipode), -np.pi / 2, atol=0.01)
    at_station = ElevationMask(np.radians(10.0), "platform")
    scene = GEOMETRIES["stations"]
    offset = scene.targets[:, None, :3] - scene.platforms[..., :3]
    sine = (offset * vertical(scene.platforms[..., :3])[0]).sum(axis=-1) / np.linalg.norm(offset, axis=-1)
    np.testing.assert_allclose(np.sin(at_station.elevation(scene.targets, scene.platforms)), sine, atol=1e-12)


@pytest.mark.parametrize("minimum", [2.0, -2.0, np.nan])
def test_bad_mask(minimum):
    with pytest.raises(ValueError, match="elevation mask"):
        ElevationMask(minimum)
