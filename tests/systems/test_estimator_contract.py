"""What every estimator block promises: its ports, what they show when, and what is used once."""

import numpy as np
import pytest
from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Merged, Periodic, Times
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.kernels.whole.stepping import Linear
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, EnsembleBlock, set_draw
from tests.laws.cases import SEVERAL_MOTIONS, estimators, fdoa, phase, tdoa
from tests.laws.rig import PORTS, Feed, Scene, make, run

ESTIMATORS = estimators()
TRIALS = 4
each_estimator = pytest.mark.parametrize("name", ESTIMATORS)


def bare_loop(algorithm, scene, stamps):
    """A filter as a loop over functions, without a block: what the ports must show at the stamps."""
    whitener = Whitener(scene.model.noise_covariance())
    mean, covariance = scene.mean, np.broadcast_to(scene.covariance, (scene.trials, 6, 6))
    rows, last = [], stamps[0]
    for k, stamp in enumerate(stamps):
        if k:
            mean, covariance = algorithm.predict(mean, covariance, scene.motion, stamp - last)
        last, before = stamp, (mean, covariance)
        platforms = scene.platforms[k].reshape(-1, 3, 6)
        result = algorithm.update(mean, covariance, Observation(scene.measurement[k], platforms, whitener), scene.model)
        mean, covariance = result.mean, result.covariance
        rows.append((mean, covariance, *before, *result[2:]))
    return dict(zip(PORTS, (np.array(column) for column in zip(*rows, strict=True)), strict=True))


def assert_same(values, expected, tolerance=1e-9):
    """Compare each port in units of the standard deviations of the estimate."""
    sigma = np.sqrt(np.diagonal(expected["prediction_covariance"], axis1=-2, axis2=-1))
    square = sigma[..., None] * sigma[..., None, :]
    scales = {
        "estimate": sigma,
        "prediction": sigma,
        "covariance": square,
        "prediction_covariance": square,
        "innovation": np.nanmax(np.abs(expected["innovation"]), axis=(0, 1)),
    }
    for port in expected:
        np.testing.assert_array_equal(np.isnan(values[port]), np.isnan(expected[port]), err_msg=port)
        error = np.nanmax(np.abs(values[port] - expected[port]) / scales.get(port, 1.0), initial=0.0)
        assert error < tolerance, f"{port}: {error:.2g}"


# -------------------------------------------------------------------------------------------------------- ports


@each_estimator
def test_ports(name):
    block = make(name, ESTIMATORS[name], trials=TRIALS)
    inputs = [block.get_input_port(i).get_name() for i in range(block.num_input_ports())]
    assert inputs[:2] == ["measurement", "platforms"]
    sizes = {
        "estimate": 6,
        "covariance": 36,
        "prediction": 6,
        "prediction_covariance": 36,
        "innovation": 6,
        "nis": 1,
        "nis_dof": 1,
    }
    assert {port: block.output_size(port) for port in sizes} == {port: (TRIALS, n) for port, n in sizes.items()}
    assert block.get_name() == name.split()[0]


@each_estimator
def test_prediction_does_not_feed_through(name):
    """It can be fed back to what makes the measurement, without an algebraic loop."""
    block = make(name, ESTIMATORS[name])
    measurement = block.GetInputPort("measurement").get_index()
    for port in PORTS:
        through = block.HasDirectFeedthrough(measurement, block.GetOutputPort(port).get_index())
        assert through == (not port.startswith("prediction"))


@each_estimator
def test_rows_are_picked_by_name(name):
    """From a stream in another order, with more in it: the same as from the rows alone."""
    options = ESTIMATORS[name]
    scene = Scene(TRIALS, 8)
    model = Stack([fdoa(), tdoa()])
    narrow = Scene(TRIALS, 8, model=Stack([tdoa(), fdoa()]))
    narrow.measurement, narrow.mean = scene.measurement[..., :4], scene.mean
    a = scene.run(name, options, model=model)
    b = narrow.run(name, options)
    assert a["innovation"].shape == (8, TRIALS, 4) and np.all(a["nis_dof"] == 4)
    stop = {"iekf 1": 1.0, "batch": 1e-2}.get(name, 1e-6)  # of their iterations
    np.testing.assert_allclose(a["estimate"], b["estimate"], rtol=0, atol=stop)
    np.testing.assert_allclose(a["innovation"][0], b["innovation"][0][:, [2, 3, 0, 1]], rtol=1e-12)


@each_estimator
def test_rows_that_are_not_measured(name):
    with pytest.raises(ValueError, match=r"rows \['phase_a', 'phase_b'\] are not measured; there are"):
        make(name, ESTIMATORS[name], stream=Stack([tdoa(), fdoa()]).names)


@pytest.mark.parametrize("change", [{"trials": 0}, {"trials": 3, "platform_trials": 2}])
def test_bad_wiring(change):
    with pytest.raises(ValueError, match="trials"):
        make("ekf", ESTIMATORS["ekf"], **change)


# ------------------------------------------------------------------------------------------------------- timing


@each_estimator
def test_a_log_row_holds_the_estimate_made_with_the_measurement_of_its_instant(name):
    scene = Scene(TRIALS, 30)
    scene.measurement[4, 1, 2:] = np.nan
    block = scene.estimator(name, ESTIMATORS[name])
    times, values = run(block, scene.measurement, scene.platforms, scene.clock)
    np.testing.assert_array_equal(times, np.arange(30.0))
    if isinstance(block, KalmanEstimator):
        assert_same(values, bare_loop(block.algorithm, scene, times))
    # first and last included: at both instants the estimate differs from the prediction
    for k in (0, 29):
        assert np.all(np.any(values["estimate"][k] != values["prediction"][k], axis=-1))
        assert np.isfinite(values["innovation"][k]).all()


@each_estimator
def test_irregular_stamps(name):
    stamps = np.cumsum([0.3, 0.1, 2.0, 0.01, 1.0, 0.5, 3.0, 0.25])
    scene = Scene(TRIALS, len(stamps))
    scene.clock = Times(stamps)
    block = scene.estimator(name, ESTIMATORS[name])
    times, values = run(block, scene.measurement, scene.platforms, scene.clock, end=stamps[-1])
    np.testing.assert_array_equal(times, stamps)
    if isinstance(block, KalmanEstimator):
        # the belief holds from the beginning of the run, 0.3 s before the first measurement
        mean, covariance = block.algorithm.predict(
            scene.mean, np.broadcast_to(scene.covariance, (TRIALS, 6, 6)), scene.motion, stamps[0]
        )
        scene.mean, scene.covariance = mean, covariance
        assert_same(values, bare_loop(block.algorithm, scene, times))
    assert np.isfinite(values["nis"]).all()


@pytest.mark.parametrize(
    ("period", "log"),
    [(1.0, Periodic(0.25)), (0.3, Periodic(0.1)), (0.1, Periodic(0.3)), (0.7, Times([0.0, 0.7 * 3 + 1e-16, 2.5]))],
    ids=["4 Hz on 1 Hz", "0.1 s on 0.3 s", "0.3 s on 0.1 s", "times on 0.7 s"],
)
@each_estimator
def test_a_recorder_faster_or_slower_than_the_filter(name, period, log):
    """Ticks that mean one instant and differ in the last bit: nothing is used twice, in no log."""
    epochs = 12
    scene = Scene(TRIALS, epochs)
    scene.clock = Periodic(period)
    block = scene.estimator(name, ESTIMATORS[name])
    end = scene.clock.ticks(100.0)[epochs - 1]
    ticks, at_ticks = run(block, scene.measurement, scene.platforms, scene.clock, end=end)
    block = scene.estimator(name, ESTIMATORS[name])
    last = max(end, log.ticks(end)[-1])
    times, values = run(block, scene.measurement, scene.platforms, scene.clock, end=last, log=log)
    assert len(ticks) == epochs and len(times) == len(log.ticks(end))
    # of those that predict by one motion
    algorithm = None if name.startswith(SEVERAL_MOTIONS) else getattr(block, "algorithm", None)
    met = 0
    for i, time in enumerate(times):
        k = scene.clock.index(time)
        if k is not None:
            met += 1
            row, expected = ({port: v[port][j : j + 1] for port in PORTS} for v, j in ((values, i), (at_ticks, k)))
            if time > ticks[k]:  # by the last bit: the update is over, and what was predicted for it is past
                for port in ("prediction", "prediction_covariance"):
                    row[port] = expected[port]
            assert_same(row, expected)
            continue
        k = int(np.searchsorted(ticks, time)) - 1
        np.testing.assert_allclose(values["estimate"][i], values["prediction"][i], rtol=1e-15)
        assert np.isnan(values["nis"][i]).all() and np.isnan(values["innovation"][i]).all()
        assert not values["nis_dof"][i].any()
        if algorithm is not None:
            mean, covariance = algorithm.predict(
                at_ticks["estimate"][k], at_ticks["covariance"][k], scene.motion, time - ticks[k]
            )
            np.testing.assert_allclose(values["estimate"][i], mean, rtol=1e-14)
            np.testing.assert_allclose(values["covariance"][i], covariance, rtol=1e-12, atol=1e-9)
    assert met >= 2


class Join(EnsembleBlock):
    """Two sensors' rows side by side."""

    def __init__(self, trials, sizes):
        super().__init__("join")
        for i, size in enumerate(sizes):
            self.declare_input(f"in{i}", trials, size)
        inputs = {self.input_ticket("in0"), self.input_ticket("in1")}
        self.declare_output(
            "out", trials, sum(sizes), lambda c: np.hstack([self.read(c, "in0"), self.read(c, "in1")]), inputs
        )


@pytest.mark.parametrize("periods", [(1.0, 0.25), (0.3, 0.1), (0.1, 0.7)], ids=str)
@each_estimator
def test_two_sensors_of_different_rates(name, periods):
    """Delays and frequencies at one rate, phases at another, one estimator that knows both clocks."""
    clocks = [Periodic(period) for period in periods]
    merged, end = Merged(clocks), 4.2
    ticks = merged.ticks(end)
    scene = Scene(TRIALS, len(ticks), model=Stack([tdoa(), fdoa(), phase()]))
    scene.clock = merged
    slow, fast = ([merged.index(tick) for tick in clock.ticks(end)] for clock in clocks)
    parts = [scene.measurement[slow][..., :4], scene.measurement[fast][..., 4:]]
    block = scene.estimator(name, ESTIMATORS[name])
    builder = DiagramBuilder()
    builder.AddSystem(block)
    join = builder.AddSystem(Join(TRIALS, (4, 2)))
    for i, (values, clock) in enumerate(zip(parts, clocks, strict=True)):
        feed = builder.AddSystem(Feed(values, clock, f"sensor{i}"))
        builder.Connect(feed.GetOutputPort("value"), join.GetInputPort(f"in{i}"))
    carriers = builder.AddSystem(Feed(scene.platforms, merged, "platforms"))
    builder.Connect(join.GetOutputPort("out"), block.GetInputPort("measurement"))
    builder.Connect(carriers.GetOutputPort("value"), block.GetInputPort("platforms"))
    recorder = record(builder, {port: block.GetOutputPort(port) for port in PORTS}, merged)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.Initialize()
    simulator.AdvanceTo(max(end, ticks[-1]))
    times, values = recorder.result(simulator.get_context())
    np.testing.assert_allclose(times, ticks, atol=1e-12)
    dof = 4.0 * np.isin(np.arange(len(ticks)), slow) + 2.0 * np.isin(np.arange(len(ticks)), fast)
    np.testing.assert_array_equal(values["nis_dof"][..., 0], np.tile(dof[:, None], (1, TRIALS)))
    if isinstance(block, KalmanEstimator):
        alone = scene.only(slice(None))
        alone.measurement = np.full_like(scene.measurement, np.nan)
        alone.measurement[slow, :, :4], alone.measurement[fast, :, 4:] = parts
        expected = bare_loop(block.algorithm, alone, times)
        got = {port: values[port].reshape(expected[port].shape) for port in PORTS}
        # where two clocks meet but for the last bit, that bit moves a target 6e6 m away by one of its last bits
        assert_same(got, expected, 1e-7)


@each_estimator
def test_a_port_read_after_the_last_update_shows_the_same(name):
    """The measurement of an instant is used once, however often and whenever a port is read."""
    scene = Scene(TRIALS, 6)
    block = scene.estimator(name, ESTIMATORS[name])
    builder = DiagramBuilder()
    builder.AddSystem(block)
    for port, values in (("measurement", scene.measurement), ("platforms", scene.platforms)):
        feed = builder.AddSystem(Feed(values, scene.clock, port))
        builder.Connect(feed.GetOutputPort("value"), block.GetInputPort(port))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.Initialize()
    for end in (0.0, 3.0, 5.0):
        simulator.AdvanceTo(end)
        mine = block.GetMyContextFromRoot(simulator.get_context())
        after = ("estimate", "covariance", "innovation", "nis", "nis_dof")
        before = {port: block.GetOutputPort(port).Eval(mine) for port in after}
        assert np.isfinite(before["nis"]).all()
        simulator.AdvancePendingEvents()
        for port in after:
            np.testing.assert_array_equal(block.GetOutputPort(port).Eval(mine), before[port], err_msg=port)


@each_estimator
def test_one_diagram_serves_many_runs(name):
    """Nothing is kept in the block: a second context is a first run again, and a clone goes on by itself."""
    scene = Scene(TRIALS, 8)
    block = scene.estimator(name, ESTIMATORS[name])
    builder = DiagramBuilder()
    builder.AddSystem(block)
    for port, values in (("measurement", scene.measurement), ("platforms", scene.platforms)):
        feed = builder.AddSystem(Feed(values, scene.clock, port))
        builder.Connect(feed.GetOutputPort("value"), block.GetInputPort(port))
    recorder = record(builder, {"estimate": block.GetOutputPort("estimate")}, scene.clock)
    diagram = builder.Build()
    logs = []
    for _ in range(2):
        context = diagram.CreateDefaultContext()
        set_draw(diagram, context, Draw(1, 2))
        simulator = Simulator(diagram, context)
        simulator.Initialize()
        simulator.AdvanceTo(7.0)
        logs.append(recorder.result(context)[1]["estimate"])
    np.testing.assert_array_equal(logs[0], logs[1])
    half = diagram.CreateDefaultContext()
    set_draw(diagram, half, Draw(1, 2))
    simulator = Simulator(diagram, half)
    simulator.Initialize()
    simulator.AdvanceTo(3.5)
    clone = half.Clone()
    for context in (half, clone):
        simulator.reset_context(context)
        simulator.Initialize(InitializeParams(suppress_initialization_events=True))  # to go on, not to start anew
        simulator.AdvanceTo(7.0)
        mine = block.GetMyContextFromRoot(context)
        np.testing.assert_array_equal(block.GetOutputPort("estimate").Eval(mine).reshape(TRIALS, 6), logs[0][-1])


@pytest.mark.parametrize("name", ["ekf", "iekf", "ukf"])
def test_a_step_in_one_call_is_prediction_and_update(name, monkeypatch):
    """To the bit, on every port, with rows missing in a trial and at an instant; and where it does not work."""
    scene = Scene(TRIALS, 20)
    measurement = scene.measurement.copy()
    measurement[5, 0, 1] = measurement[9] = np.nan
    ports = [port for port in PORTS if not port.startswith("prediction")]  # who reads those has it in two calls
    steps = []
    step = Linear.__call__

    def counted(*arguments):
        steps.append(step(*arguments))
        return steps[-1]

    def told(step):
        monkeypatch.setattr(Linear, "__call__", step)
        return run(scene.estimator(name, ESTIMATORS[name]), measurement, scene.platforms, scene.clock, ports=ports)[1]

    def spoiling(self, state, *rest):
        state[:] = -1.0
        return False

    whole, apart = told(counted), told(spoiling)
    # 20 epochs without the first, which the start has used, and two with gaps
    assert steps == [True] * 4 + [False] + [True] * 3 + [False] + [True] * 10
    for port in ports:
        np.testing.assert_array_equal(whole[port], apart[port], err_msg=port)
    steps.clear()
    noise = np.tile(4 * scene.model.noise_covariance().ravel(), (scene.epochs, TRIALS, 1))
    block = scene.estimator(name, ESTIMATORS[name], noise_port=True)
    wider = run(block, measurement, scene.platforms, scene.clock, inputs={"noise_covariance": noise}, ports=ports)[1]
    # where R comes with the measurement it is that R which counts
    assert not steps and np.nanmean(wider["nis"]) < 0.5 * np.nanmean(whole["nis"])
