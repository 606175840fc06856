import numpy as np
import pytest

from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.commands.mapping import map_figures
from quietfix.diagrams.figures.gdop import draw_gdop
from quietfix.diagrams.library.models.three_satellite import bound_map, measurement_sets, models
from quietfix.diagrams.library.three_satellite import SYSTEM
from quietfix.diagrams.maps.bounds import last_bound, map_bounds
from quietfix.diagrams.maps.ground import GroundPrior, ground_areas, ground_grid, ground_map
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from quietfix.systems.measurement.stack import Stack
from tests.fitting import check_fits

SETS = {
    "TDOA+phA": ["tdoa", "phase_a"],
    "TDOA+phB": ["tdoa", "phase_b"],
    "TDOA+FDOA": ["tdoa", "fdoa"],
    "+phA": ["tdoa", "fdoa", "phase_a"],
    "+phB": ["tdoa", "fdoa", "phase_b"],
    "all six": ["tdoa", "fdoa", "phase"],
}

# Of an independent prototype, by (formation, process noise). Areas [10^6 km^2]: position < 1, 2, 5 km, height < 1,
# 0.5 km; bound at the centre [km]: position, height.
REFERENCE = {
    (None, 0.1): {
        "TDOA+phA": (0, 0.30, 4.34, 0.07, 0, 2.81, 2.24),
        "TDOA+phB": (0, 1.19, 5.54, 0.10, 0, 1.40, 1.12),
        "TDOA+FDOA": (0, 2.18, 8.53, 3.97, 0.09, 1.41, 1.12),
        "+phA": (0, 2.27, 8.60, 4.20, 0.10, 1.41, 1.12),
        "+phB": (0.10, 2.70, 8.96, 5.48, 0.10, 1.06, 0.84),
        "all six": (0.10, 2.77, 9.06, 5.80, 0.12, 1.06, 0.84),
    },
    ("coplanar", 0.1): {
        "TDOA+phA": (0, 0, 0.20, 0.14, 0.06, 47.5, 3.4),
        "TDOA+phB": (8.13, 9.57, 9.57, 9.57, 6.91, 0.19, 0.07),
        "TDOA+FDOA": (0, 0, 2.01, 0.33, 0.13, 17.3, 1.2),
        "+phA": (0, 0, 2.01, 0.33, 0.13, 17.3, 1.2),
        "all six": (8.56, 9.57, 9.57, 9.57, 7.15, 0.19, 0.07),
    },
    (None, 0.01): {
        "TDOA+phA": (0.01, 0.97, 5.09, 0.67, 0, 2.30, 1.84),
        "TDOA+phB": (0.11, 1.68, 5.89, 0.90, 0, 1.32, 1.06),
        "TDOA+FDOA": (2.16, 5.57, 9.40, 8.96, 2.76, 0.62, 0.50),
        "+phA": (2.17, 5.66, 9.42, 8.96, 2.88, 0.62, 0.50),
        "+phB": (2.26, 5.77, 9.50, 9.08, 3.01, 0.58, 0.46),
        "all six": (2.28, 5.79, 9.50, 9.09, 3.11, 0.58, 0.46),
    },
    (None, 0.0): {"all six": (2.38, 5.86, 9.50, 9.11, 3.33, 0.56, 0.45)},
}


def gdop_map(*what, **options):
    return map_bounds(bound_map(*what, **options))


def scenario_of(formation, acceleration):
    return load_scenario("three_satellite", formation, settings=[f"belief.acceleration_mps2={acceleration}"])


def bound_after_pass(scenario, grid, kinds, prior):
    stack = Stack([models(scenario, True)[kind] for kind in kinds])
    names = [f"satellite_{i}" for i in range(grid.platforms.shape[2])]
    of = ground_map(scenario, grid, {"one": stack}, scenario.belief.acceleration_mps2, prior, names)
    return last_bound(of, stack)


def last_digit(value):
    text = f"{value:g}"
    return 10.0 ** -len(text.partition(".")[2])


def check_centre(value, reference):
    """Within 3 %, and half of the last printed digit."""
    assert abs(value - reference) <= 0.03 * reference + 0.5 * last_digit(reference)


def check_area(value, reference):
    assert abs(value - reference) <= max(0.1 * reference, 0.05)


@pytest.mark.parametrize(
    ("formation", "acceleration"),
    [
        (None, 0.1),
        ("coplanar", 0.1),
        pytest.param(None, 0.01, marks=pytest.mark.slow),
        pytest.param(None, 0.0, marks=pytest.mark.slow),
    ],
)
def test_maps_are_those_of_the_reference(formation, acceleration):
    scenario, reference = scenario_of(formation, acceleration), REFERENCE[formation, acceleration]
    grid = ground_grid(scenario)
    assert 0.01 * grid.seen.sum() == pytest.approx(9.6, abs=0.05)
    centre = np.flatnonzero(grid.seen.ravel()).searchsorted(grid.seen.size // 2)
    # The reference counts height along the radius at the *first* epoch; see the next test for what is right.
    radial = grid.truth[:, 0, :3] / np.linalg.norm(grid.truth[:, 0, :3], axis=-1, keepdims=True)
    for name, (p1, p2, p5, h1, h05, centre_p, centre_h) in reference.items():
        covariance = bound_after_pass(scenario, grid, SETS[name], GroundPrior())[:, :3, :3]
        position = np.sqrt(np.trace(covariance, axis1=-2, axis2=-1)) / 1e3
        height = np.sqrt((radial[:, None, :] @ covariance @ radial[..., None])[:, 0, 0]) / 1e3
        for bound, limit, area in (
            (position, 1, p1),
            (position, 2, p2),
            (position, 5, p5),
            (height, 1, h1),
            (height, 0.5, h05),
        ):
            check_area(0.01 * (bound < limit).sum(), area)
        check_centre(position[centre], centre_p)
        check_centre(height[centre], centre_h)


def test_height_is_that_of_the_place_at_the_last_epoch():
    """The spread of the heights of drawn states: 4 % more than along the vertical of the first epoch."""
    scenario = scenario_of("coplanar", 0.1)
    found = gdop_map(scenario, {"one": SETS["TDOA+phA"]}, extent_km=0.0)
    grid = ground_grid(scenario, extent_km=0.0)
    covariance = bound_after_pass(scenario, grid, SETS["TDOA+phA"], GroundPrior())[0, :3, :3]
    small = 1e-3  # so that the curvature of the Earth does not matter
    rng = np.random.default_rng(0)
    drawn = small * np.einsum("ij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal((40_000, 3)))
    spread = np.std(ecef_to_geodetic(grid.truth[0, -1, :3] + drawn)[2]) / small
    # 40 000 draws know a standard deviation to 0.35 %; 3 of them
    assert float(found["height"].squeeze()) == pytest.approx(spread, rel=0.0106)
    assert float(found["height"].squeeze()) == pytest.approx(3554, rel=0.001)


def test_map_along_the_cuts_of_the_reference():
    found = gdop_map(scenario_of(None, 0.1), {"all": SETS["all six"]}, spacing_km=300.0).sel(set="all")
    along = [7.5, 5.1, 3.3, 2.1, 1.4, 1.06, 0.97, 1.2, 1.9, 3.3, 5.4]
    cross = [2.27, 1.75, 1.38, 1.17, 1.07, 1.06, 1.35, 2.0, 2.8, 3.5, 4.2]
    height = [0.66, 0.68, 0.69, 0.74, 0.81, 0.84, 0.97, 1.17, 1.26, 1.18, 1.04]
    for values, reference in (
        (found["position"].sel(cross=0), along),
        (found["position"].sel(along=0), cross),
        (found["height"].sel(along=0), height),
    ):
        np.testing.assert_allclose(values / 1e3, reference, rtol=0.03)


def test_areas_count_cells():
    found = gdop_map(scenario_of(None, 0.1), {"all": SETS["all six"]}, spacing_km=500.0)
    areas = ground_areas(found)["all"]
    values = found["position"].values
    assert areas["visible"] == pytest.approx(0.25 * np.isfinite(values).sum())
    assert areas["position_below_2000_m"] == pytest.approx(0.25 * (values < 2000).sum()) and (values < 2000).any()
    assert areas["centre_position_m"] == pytest.approx(values[0, 3, 3])
    assert all(type(value) is float for value in areas.values())


def test_satellites_stand_where_the_reference_has_them():
    """Satellite 0 at the origin at mid pass; the pair 69 km to its left, 40 km behind and ahead."""
    track = gdop_map(scenario_of(None, 0.1), {"one": ["tdoa"]}, extent_km=0.0)["track"].sel(time=75.0)
    expected = np.array([[0.0, 0.0], [-40.0, -69.3], [40.0, -69.3]]) * 6378.137 / 7078.137
    np.testing.assert_allclose(track, expected, atol=4.0)  # the planes' distance shrinks away from the node
    np.testing.assert_allclose(track[0], 0.0, atol=1e-6)


def test_sets_of_the_scenario_are_mapped_once():
    sets = measurement_sets(load_scenario("three_satellite"))
    assert list(sets.values()) == [["tdoa", "fdoa", "phase"], ["tdoa", "fdoa", "phase_a"], ["tdoa", "phase_a"]]


def test_users_mistakes_are_named():
    scenario = scenario_of(None, 0.1)
    with pytest.raises(UserError, match=r"tdao.*did you mean tdoa"):
        gdop_map(scenario, {"one": ["tdao"]})
    for spacing, extent in ((0.0, 1500.0), (np.nan, 1500.0), (100.0, -1.0), (100.0, np.inf)):
        with pytest.raises(UserError, match="grid"):
            gdop_map(scenario, {"one": ["tdoa"]}, spacing, extent)


def test_figures_and_table(tmp_path, capsys, printed_tables):
    scenario = scenario_of(None, 0.1)
    scenario.estimators = {"iekf_tdoa_phase": scenario.estimators["iekf_tdoa_phase"]}
    map_figures(SYSTEM, scenario, tmp_path, progress=False)
    names = {"gdop_position_tdoa_phase_a.png", "gdop_height_tdoa_phase_a.png"}
    assert {path.name for path in tmp_path.iterdir()} == names
    printed = capsys.readouterr().out
    assert "9.59" in printed and "4.34" in printed and "0.1 m/s^2" in printed and "5 km in height" in printed
    check_fits(printed_tables[0])


def test_a_map_that_nobody_sees_is_drawn_empty(tmp_path):
    found = gdop_map(scenario_of(None, 0.1), {"one": ["tdoa"]}, spacing_km=3000.0, extent_km=3000.0)
    blank = found.assign(position=found["position"] * np.nan, height=found["height"] * np.nan)
    assert all(path.stat().st_size > 5000 for path in draw_gdop(blank, tmp_path))
