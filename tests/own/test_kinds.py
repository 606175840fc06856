"""What holds for every kind of measurement in the table, a new one too: nothing is to be listed here for it."""

import dataclasses
import pickle

import numpy as np
import pytest

from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.fields.sensors import KINDS, TimedKind
from quietfix.diagrams.paths.places import Places, Timed
from quietfix.diagrams.quantities.frame import EARTH_FIXED, INERTIAL, LOCAL
from quietfix.diagrams.readers.units import UNITS
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.reading import fields_of, options_of, read
from quietfix.systems.trajectories.gravity import GravityConstants

NAMES = ["alpha", "bravo", "charlie"]
MEAN = {
    LOCAL.name: np.array([2e3, -1e3, 800.0, 40.0, -20.0, 3.0]),
    EARTH_FIXED.name: np.array([6.37e6, 3e5, -2e5, 100.0, 50.0, -80.0]),
    INERTIAL.name: np.array([6.9e6, 3e5, -2e5, 200.0, 7300.0, 900.0]),
}
"""A target in each frame; platforms are around it."""

EXAMPLES = {
    "Custom": {
        "class": "quietfix.systems.measurement.component:Component",
        "options": {"index": 2, "sigma": 30.0, "name": "depth", "unit": "m"},
    }
}
"""Fields of a kind whose defaults are not enough."""

each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)


def placed(kind):
    """A kind in the first frame that takes it: its model, rows, and the frame's name."""
    field = read(kind, EXAMPLES.get(kind.__name__, {}))
    for frame in (LOCAL, EARTH_FIXED, INERTIAL):
        places = Places({name: i for i, name in enumerate(NAMES)}, frame, GravityConstants())
        try:
            return (*field.placed(places, "sensors.one"), frame.name)
        except UserError as error:
            assert "frame" in str(error)
    raise AssertionError("no frame takes it")


@each_kind
def test_rows_have_names_and_units_that_a_table_may_say(kind):
    model, rows, _ = placed(kind)
    assert [row.name for row in rows] == list(model.names) and len(set(model.names)) == len(rows) > 0
    assert [row.unit for row in rows] == list(model.units)
    for row in rows:
        assert row.unit in UNITS and row.kind
        assert row.receiver in ("", *NAMES) and row.reference in ("", *NAMES)
        assert not row.compares_clocks or (row.receiver and row.reference and kind.compares_clocks)


@each_kind
def test_the_derivative_is_the_models(kind):
    """Central differences of 1 cm and 1 cm/s: good to rounding of 1e-9 m at 7000 km over 2 cm, and of an altitude's."""
    model, _, frame = placed(kind)
    rng = np.random.default_rng(8)
    target = MEAN[frame] + rng.normal(size=(20, 6)) * [500, 500, 300, 5, 5, 5]
    platforms = MEAN[frame] + rng.normal(size=(20, 3, 6)) * [8e3, 8e3, 2e3, 30, 30, 30]
    steps = 1e-2 * np.eye(6)
    columns = [
        model.residual(model.predict(target + step, platforms), model.predict(target - step, platforms)) / 2e-2
        for step in steps
    ]
    jacobian = model.jacobian(target, platforms)
    scale = np.abs(jacobian).max(axis=(0, 2), keepdims=True)
    assert np.isfinite(jacobian).all() and (scale > 0).all()
    np.testing.assert_allclose(np.stack(columns, axis=-1) / scale, jacobian / scale, rtol=0, atol=1e-6)


@each_kind
def test_its_sensor_has_a_clock_and_its_fields(kind):
    sensors = options_of(fields_of(OwnScenario)["sensors"].type.__args__[1])
    sensor = next(one for one in sensors if one.__name__ == kind.__name__)
    assert issubclass(sensor, kind) and issubclass(sensor, TimedKind)
    names = [field.name for field in dataclasses.fields(sensor)]
    assert names == [field.name for kind_ in (Timed, kind) for field in dataclasses.fields(kind_)]
    assert sensor.__doc__ == kind.__doc__
    there = read(sensor, {"every_s": 3.0})
    assert pickle.loads(pickle.dumps(there)) == there  # as a pool of processes hands a scenario on
