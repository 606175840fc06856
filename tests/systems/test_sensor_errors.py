"""Attitude error, offsets, gross errors and missing rows behind a sensor."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.clocks import Periodic
from quietfix.systems.earth.frames import nadir_frame_earth_fixed
from quietfix.systems.geometry.misalignment import rotation_matrix, seen_from_turned_axes
from quietfix.systems.sensors.attitude_error import AttitudeError
from quietfix.systems.sensors.reading_error import ReadingError
from quietfix.systems.signals import Constant, Draw, set_draw

CLOCK = Periodic(1.0)
SATELLITE = np.array([7.0e6, 2e5, 1e5, -300.0, 3.7e3, 6.4e3])
TARGET = np.array([6.36e6, 4e5, 3e5, 100.0, 200.0, 50.0])
PHASE = InterferometerPhase(0.1, 3.0, 0.1, wrapped=True)
SPREAD = dict.fromkeys(ROWS, 1.0)


def body(carrier):
    return nadir_frame_earth_fixed(carrier[..., :3], carrier[..., 3:])


def impaired(block, measured, inputs=(), draw=None):
    """What comes out of a block that is given one measurement."""
    builder = DiagramBuilder()
    builder.AddSystem(block)
    for port, value in {"measurement": measured, **dict(inputs)}.items():
        source = builder.AddSystem(Constant(f"given_{port}", value))
        builder.Connect(source.GetOutputPort("state"), block.GetInputPort(port))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    set_draw(diagram, simulator.get_mutable_context(), draw or Draw(3))
    context = block.GetMyContextFromRoot(simulator.get_context())
    return block.GetOutputPort("measurement").Eval(context).reshape(np.shape(measured))


def test_rotation_matrix_is_scipys():
    vectors = np.random.default_rng(0).standard_normal((50, 3)) * np.logspace(-9, 0.4, 50)[:, None]
    np.testing.assert_allclose(rotation_matrix(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-15)


def test_turned_interferometer():
    """The phase of a turned interferometer, from its axes directly: 2 pi n e'.u with e' = R e in body axes."""
    vector = np.radians([0.05, -0.2, 1.0])
    frame = body(SATELLITE)
    direction = (TARGET - SATELLITE)[:3] / np.linalg.norm((TARGET - SATELLITE)[:3])
    axes = Rotation.from_rotvec(vector).as_matrix()[:, :2].T @ frame  # the turned x and y, in Earth-fixed axes
    expected = 2 * np.pi * 30 * axes @ direction
    seen = seen_from_turned_axes(TARGET, SATELLITE, rotation_matrix(vector), frame)
    np.testing.assert_allclose(PHASE.predict(seen, SATELLITE[None]), expected, rtol=1e-12)
    # behind a sensor: wrapped, and the missing row stays missing
    block = AttitudeError(PHASE, PHASE.names, 2, 1, vector, body=body)
    exact = wrap(PHASE.predict(TARGET, SATELLITE[None]))
    given = np.stack([exact, [np.nan, exact[1]]])
    found = impaired(block, given, {"target": TARGET, "platforms": SATELLITE})
    np.testing.assert_allclose(wrap(found[0] - expected), 0, atol=1e-9)
    assert np.isnan(found[1, 0]) and found[1, 1] == found[0, 1]


def test_roll_of_the_interferometer_is_a_phase_of_the_across_axis():
    """0.05 deg about the track: cos(depression) 2 pi n 0.05 deg on the across phase, nothing on the other."""
    turn = rotation_matrix(np.radians([0.05, 0, 0]))
    moved = PHASE.predict(seen_from_turned_axes(TARGET, SATELLITE, turn, body(SATELLITE)), SATELLITE[None])
    moved -= PHASE.predict(TARGET, SATELLITE[None])
    offset = body(SATELLITE) @ (TARGET - SATELLITE)[:3]
    np.testing.assert_allclose(moved[0], 0, atol=1e-12)
    np.testing.assert_allclose(
        moved[1], 2 * np.pi * 30 * np.radians(0.05) * offset[2] / np.linalg.norm(offset), rtol=1e-3
    )


def test_turned_axes_of_angles_and_rates():
    """Turned about z: azimuth and only it moves, by the angle; about any axis: the rates of the turned angles."""
    model = RelativeKinematics(SPREAD)
    one = seen_from_turned_axes(TARGET, SATELLITE, rotation_matrix([0, 0, 0.01]))
    moved = model.predict(one, SATELLITE[None]) - model.predict(TARGET, SATELLITE[None])
    np.testing.assert_allclose(moved[:5], [-0.01, 0, 0, 0, 0], atol=1e-9)
    turn, dt = rotation_matrix([0.3, -0.2, 0.5]), 1e-2

    def at(time):
        step = np.concatenate([time * np.ones(3), np.zeros(3)])
        target, carrier = (x + step * np.concatenate([x[3:], np.zeros(3)]) for x in (TARGET, SATELLITE))
        return model.predict(seen_from_turned_axes(target, carrier, turn), carrier[None])

    np.testing.assert_allclose((at(dt) - at(-dt))[:2] / (2 * dt), at(0)[2:4], rtol=1e-6)


def test_heading_in_the_plane():
    model = Bearing(0.01)
    block = AttitudeError(model, model.names, 1, 1, [0, 0, 0.1], target_size=2, axes=2)
    found = impaired(block, [[0.3]], {"target": [1e4, 3e3], "platforms": np.zeros(6)})
    np.testing.assert_allclose(found, [[0.2]], atol=1e-12)


def test_random_attitude_is_drawn_per_trial():
    """Standard deviation per axis within 3 sigma of 4000 trials (3.4 %); trial 7 alone is trial 7 of the batch."""
    block = AttitudeError(PHASE, PHASE.names, 4000, 1, sigma=0.01, body=body)
    turns = block.turn(Draw(5))
    vectors = Rotation.from_matrix(turns).as_rotvec()
    np.testing.assert_allclose(vectors.std(axis=0), 0.01, rtol=0.034)
    alone = AttitudeError(PHASE, PHASE.names, 1, 1, sigma=0.01, body=body)
    np.testing.assert_array_equal(alone.turn(Draw(5, 7)), turns[7:8])


def reading(trials=4000, **options):
    return ReadingError(Bearing(0.01), CLOCK, trials, **options)


def test_offsets_of_clocks_share_the_reference():
    """Two differences against one reference: variances 2 s^2, covariance s^2 (within 4 sigma of 4000 trials)."""
    root = 3.0 * np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
    model = Bearing(0.01, 0.01)
    block = ReadingError(model, CLOCK, 4000, bias=[0.5, -0.5], bias_root=root)
    model.represent = lambda value: value  # lengths here, not angles
    found = impaired(block, np.zeros((4000, 2)))
    np.testing.assert_allclose(found.mean(axis=0), [0.5, -0.5], atol=4 * 3 * np.sqrt(2 / 4000))
    np.testing.assert_allclose(np.cov(found.T), 9 * np.array([[2, 1], [1, 2]]), atol=4 * 18 * np.sqrt(2 / 4000))
    # constant through a run
    np.testing.assert_array_equal(block.impair(np.zeros((4000, 2)), Draw(3), 9), found)


def test_rates_of_gross_errors_and_missing_rows():
    """Shares within 4 sigma of 4000 trials; a larger rate impairs the same rows and more; other rows untouched."""
    zero = np.zeros((4000, 1))
    few, many = (impaired(reading(outlier_rate=rate), zero) for rate in (0.1, 0.3))
    assert abs((few != 0).mean() - 0.1) < 4 * np.sqrt(0.09 / 4000)
    assert np.all(many[few != 0] == few[few != 0])
    np.testing.assert_allclose(few[few != 0].std(), 20 * 0.01, rtol=4 / np.sqrt(2 * 400))
    gone = [np.isnan(impaired(reading(drop_out_rate=rate), zero)) for rate in (0.2, 0.5)]
    assert abs(gone[0].mean() - 0.2) < 4 * np.sqrt(0.16 / 4000)
    assert gone[1][gone[0]].all()
    assert np.all(impaired(reading(drop_out_rate=0.2), zero)[~gone[0]] == 0)
    assert np.isnan(impaired(reading(drop_out_rate=1.0), zero)).all()


def test_a_trial_alone_is_the_same():
    options = {"outlier_rate": 0.5, "drop_out_rate": 0.3, "bias_root": [[0.1]]}
    batch = reading(50, **options).impair(np.zeros((50, 1)), Draw(1), 4)
    alone = reading(1, **options).impair(np.zeros((1, 1)), Draw(1, 37), 4)
    np.testing.assert_array_equal(alone, batch[37:38])


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: reading(outlier_rate=1.5), "outlier_rate 1.5"),
        (lambda: reading(drop_out_rate=-0.1), "drop_out_rate -0.1"),
        (lambda: reading(outlier_scale=0.0), "outlier_scale 0"),
        (lambda: reading(bias=[1.0, 2.0]), "do not fit 1 rows"),
        (lambda: AttitudeError(PHASE, ["phase_c"], 1, 1), "phase_c"),
        (lambda: AttitudeError(PHASE, [], 1, 1), "rows none"),
        (lambda: AttitudeError(PHASE, ["phase_a"], 1, 1, sigma=-1.0), "sigma -1"),
        (lambda: AttitudeError(PHASE, ["phase_a"], 1, 1, bias=[np.nan, 0, 0]), "three finite"),
        (lambda: AttitudeError(Bearing(0.1), ["azimuth"], 1, 1, [0.1, 0, 0], axes=2), "only about z"),
    ],
)
def test_refuses(make, word):
    with pytest.raises(ValueError, match=word):
        make()
