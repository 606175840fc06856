"""The orbit blocks against SciPy's DOP853 and against what an orbit conserves."""

import gc
import weakref
from importlib.metadata import version

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from scipy.integrate import solve_ivp

from quietfix.systems.earth.frames import acceleration_to_earth_fixed, inertial_to_earth_fixed
from quietfix.systems.plants.orbit import DenseOrbit, Orbit, derivative
from quietfix.systems.trajectories.gravity import GravityConstants, acceleration, energy
from quietfix.systems.trajectories.kepler import KeplerElements, mean_motion, state_of

EARTH = GravityConstants()
OLD_DRAKE = tuple(int(n) for n in version("drake").split(".")[:2]) < (1, 58)
AXIS = 6378137.0 + 700e3
RAAN = 69.28e3 / AXIS / np.sin(np.radians(60))
# the formation "tri" of the reference: a pair +-40 km along the track, satellite 0 in a plane to the right
TRI = state_of(
    KeplerElements(AXIS, 0.0, np.radians(60), [RAAN, 0.0, 0.0], 0.0, [-RAAN * 0.5, -40e3 / AXIS, 40e3 / AXIS]),
    EARTH.mu,
)
REVOLUTION = float(2 * np.pi / mean_motion(AXIS, EARTH.mu))


def run(block, end, step=1.0):
    simulator = Simulator(block)
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme="runge_kutta5", max_step_size=step, use_error_control=False),
        simulator,
    )
    simulator.Initialize()
    simulator.AdvanceTo(end)
    return simulator


def port(block, context, name):
    return block.GetOutputPort(name).Eval(context).reshape(block.output_size(name))


@pytest.fixture(scope="module", params=[True, False], ids=["j2", "two-body"])
def after_one_revolution(request):
    j2 = request.param

    def rate(t, x):
        """Two-body + J2 written out again, one satellite at a time, as the reference's formula."""
        out = []
        for r, v in x.reshape(-1, 2, 3):
            d = np.sqrt(r @ r)
            a = -EARTH.mu * r / d**3
            if j2:
                factor = 1.5 * EARTH.j2 * EARTH.mu * EARTH.radius**2 / d**5
                a = a - factor * r * (np.array([1, 1, 3]) - 5 * r[2] ** 2 / d**2)
            out += [v, a]
        return np.concatenate(out)

    reference = solve_ivp(rate, (0, REVOLUTION), TRI.ravel(), method="DOP853", rtol=1e-12, atol=1e-9)
    orbit, dense = Orbit(TRI, j2=j2), DenseOrbit(TRI, REVOLUTION, j2=j2)
    context = dense.CreateDefaultContext()
    context.SetTime(REVOLUTION)
    simulator = run(orbit, REVOLUTION)
    states = {
        "continuous": port(orbit, simulator.get_context(), "inertial").reshape(3, 6),
        "dense": port(dense, context, "inertial").reshape(3, 6),
    }
    return j2, reference.y[:, -1].reshape(3, 6), states


@pytest.mark.parametrize("kind", ["continuous", "dense"])
def test_within_a_millimetre_of_dop853(after_one_revolution, kind):
    _, reference, states = after_one_revolution
    difference = states[kind] - reference
    assert np.abs(difference[:, :3]).max() < 1e-3  # the requirement; measured 1.1e-5 m and 3e-8 m
    assert np.abs(difference[:, 3:]).max() < 1e-6  # the same, times the orbit rate of 1e-3 rad/s; measured 1.4e-8


@pytest.mark.parametrize("kind", ["continuous", "dense"])
def test_energy_and_polar_momentum_are_conserved(after_one_revolution, kind):
    j2, _, states = after_one_revolution
    before, after = (energy(x, EARTH, j2) for x in (TRI, states[kind]))
    np.testing.assert_allclose(after, before, rtol=1e-10)  # the requirement; measured 2e-14
    hz = [np.cross(x[:, :3], x[:, 3:])[:, 2] for x in (TRI, states[kind])]
    np.testing.assert_allclose(hz[1], hz[0], rtol=1e-10)


def test_dense_orbit_is_as_exact_between_its_steps():
    dense = DenseOrbit(TRI, REVOLUTION)
    times = np.linspace(0, REVOLUTION, 301)
    exact = solve_ivp(
        lambda t, x: derivative(x.reshape(-1, 6), EARTH).ravel(),
        (0, REVOLUTION), TRI.ravel(), method="DOP853", rtol=1e-13, atol=1e-9, max_step=20.0, t_eval=times,
    )  # fmt: skip
    difference = dense.at(times).reshape(301, -1) - exact.y.T
    assert np.abs(difference.reshape(301, 3, 2, 3)[:, :, 0]).max() < 1e-3  # measured 1.3e-5 m
    np.testing.assert_array_equal(dense.at(times[7]), dense.at(times)[7])


@pytest.mark.parametrize("kind", ["continuous", "dense"])
def test_ports(kind):
    t = 150.0
    if kind == "dense":
        block = DenseOrbit(TRI, 200.0)
        context = block.CreateDefaultContext()
        context.SetTime(t)
    else:
        block = Orbit(TRI)
        context = run(block, t).get_context()
    inertial = port(block, context, "inertial")
    assert inertial.shape == (1, 18)
    x = inertial.reshape(3, 6)
    fixed = inertial_to_earth_fixed(x, t, EARTH.earth_rate)
    np.testing.assert_array_equal(port(block, context, "state").reshape(3, 6), fixed)
    a = port(block, context, "acceleration").reshape(3, 3)
    np.testing.assert_array_equal(a, acceleration(x[:, :3], EARTH))
    # the Earth-fixed velocity's own derivative, over 2 s: truncation a w^2/6 ~ 2e-6 m/s^2
    ends = [inertial_to_earth_fixed(DenseOrbit(TRI, 200.0).at(s), s) for s in (t - 1, t + 1)]
    slope = (ends[1] - ends[0])[:, 3:] / 2
    np.testing.assert_allclose(acceleration_to_earth_fixed(a, x, t), slope, atol=5e-6)


def test_the_constants_are_the_users():
    other = GravityConstants(mu=3.9e14, radius=6.3e6, j2=0.0, earth_rate=0.0)
    block = DenseOrbit(TRI, 10.0, other)
    context = block.CreateDefaultContext()
    context.SetTime(5.0)
    np.testing.assert_array_equal(port(block, context, "state"), port(block, context, "inertial"))
    np.testing.assert_allclose(
        port(block, context, "acceleration").reshape(3, 3),
        acceleration(block.at(5.0)[:, :3], GravityConstants(mu=3.9e14), j2=False),
        rtol=1e-14,
    )


def test_trials_start_differently_and_one_alone_is_bit_equal():
    starts = TRI + np.random.default_rng(2).normal(0, 100.0, (7, 3, 6))
    together, alone = Orbit(starts), Orbit(starts[5:6])
    a = port(together, run(together, 20.0).get_context(), "state")
    b = port(alone, run(alone, 20.0).get_context(), "state")
    assert a.shape == (7, 18) and b.shape == (1, 18)
    np.testing.assert_array_equal(a[5], b[0])
    assert np.ptp(a, axis=0).min() > 0


def test_the_number_of_python_calls_does_not_depend_on_the_trials(monkeypatch):
    calls = {}
    for trials in (1, 50):
        count = [0]

        def counted(*arguments, count=count):
            count[0] += 1
            return derivative(*arguments)

        monkeypatch.setattr("quietfix.systems.plants.orbit.derivative", counted)
        run(Orbit(np.broadcast_to(TRI, (trials, 3, 6))), 10.0)
        calls[trials] = count[0]
    assert calls[1] == calls[50] > 0


def test_the_dense_orbit_says_when_it_is_asked_too_late():
    block = DenseOrbit(TRI, 100.0)
    context = block.CreateDefaultContext()
    context.SetTime(100.0)
    port(block, context, "state")
    for time in (101.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="solved from 0 to 100"):
            block.at(time)
    context.SetTime(101.0)
    with pytest.raises(ValueError, match="later `end`"):
        port(block, context, "state")


def broken(satellite, index, value):
    x = TRI.copy()
    x[satellite, index] = value
    return x


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        (np.empty((0, 6)), "zero satellites"),
        (np.empty((0, 3, 6)), "zero trials"),
        (TRI[:, :5], "shape"),
        (TRI[0], "shape"),
        (broken(1, 4, np.nan), "satellite 1 has a number"),
        (broken(2, 0, np.inf), "satellite 2 has a number"),
        (TRI * 1e-3, "satellite 0 starts below the Earth's surface"),
    ],
)
@pytest.mark.parametrize("make", [Orbit, lambda x: DenseOrbit(x, 10.0)], ids=["continuous", "dense"])
def test_bad_starts(initial, message, make):
    with pytest.raises(ValueError, match=message):
        make(initial)


def test_bad_ends_and_trials():
    for end in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="orbit end"):
            DenseOrbit(TRI, end)
    with pytest.raises(ValueError, match="2 trials are not allowed"):
        DenseOrbit(np.stack([TRI, TRI]), 10.0)


@pytest.mark.skipif(OLD_DRAKE, reason="Drake before 1.58 keeps every system alive, with or without a cache entry")
@pytest.mark.parametrize("make", [lambda: Orbit(TRI), lambda: DenseOrbit(TRI, 10.0)], ids=["continuous", "dense"])
def test_blocks_are_not_pinned_in_memory(make):
    block = make()
    block.GetOutputPort("state").Eval(block.CreateDefaultContext())
    alive = weakref.ref(block)
    del block
    gc.collect()
    assert alive() is None
