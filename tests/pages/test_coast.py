"""Coast lines: where the coast is, on maps of a report and on the Earth of a scene."""

import numpy as np
import pytest

from quietfix.diagrams.pages.coast import coast_lines, coast_within
from quietfix.diagrams.scenes.ground import coasts
from quietfix.systems.earth.geodetic import ecef_to_geodetic


# the Cape of Good Hope, Land's End, Cape Horn, Cape Comorin, as any atlas has them
@pytest.mark.parametrize("place", [(18.5, -34.4), (-5.7, 50.1), (-67.3, -55.9), (77.5, 8.1)])
def test_capes_are_where_they_are(place):
    every = np.concatenate(coast_lines())
    assert np.abs(every[:, 0]).max() <= 180 and np.abs(every[:, 1]).max() <= 90
    # a scale of 1:110 million leaves out what is smaller than some tens of kilometres
    assert np.hypot(*(every - place).T).min() < 1.0


def test_edges_of_the_map_are_no_coast():
    for line in coast_lines():
        edge = (np.abs(line[:, 0]) > 179.98) | (line[:, 1] < -89.9)
        assert not (edge[1:] & edge[:-1]).any()


def test_what_is_around_a_place_goes_on_over_the_date_line():
    around = coast_within(175, 185, -45, -35)
    assert around and all(172 < line[:, 0].min() <= line[:, 0].max() < 190 for line in around)
    again = coast_within(535, 545, -45, -35)
    assert np.allclose(np.concatenate(again), np.concatenate(around) + np.array([360, 0]))
    assert coast_within(-40, -38, 30, 32) == []  # the middle of the Atlantic


def test_coasts_lie_on_the_ellipsoid_in_short_pieces():
    found = coasts()
    _, _, height = ecef_to_geodetic(found.starts)
    assert np.abs(height).max() < 1e-3
    assert np.linalg.norm(found.ends - found.starts, axis=-1).max() < 170e3  # a degree across and one along
