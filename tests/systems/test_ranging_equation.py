"""The ranging equation: roots, partials, covariances, and what the paper prints."""

import numpy as np
import pytest

from quietfix.systems.angles.relative_kinematics import RelativeKinematics, sight_axes
from quietfix.systems.fixes.ranged_position import RangedPosition, ranging_equation
from quietfix.systems.fixes.ranging import RangingEquation
from quietfix.systems.trajectories.gravity import acceleration
from tests.systems.ranging_scene import EARTH, SIGMAS, TIMES, arc, measurements, sensor


def scene(j2=False):
    observer, target = arc(j2)
    exact = sensor(j2).predict(target, observer[:, None])
    return RangingEquation(EARTH, j2), exact, observer, target, np.linalg.norm((target - observer)[:, :3], axis=-1)


@pytest.mark.parametrize("j2", [False, True])
def test_the_true_range_is_a_root_over_the_whole_arc(j2):
    equation, exact, observer, _, distance = scene(j2)
    roots = equation.ranges(exact, observer)
    assert np.nanmin(np.abs(roots - distance[:, None]), axis=-1).max() < 1e-3  # 1e-6 in fact
    assert distance.min() == pytest.approx(13866.7e3, abs=100)
    assert j2 or distance.max() == pytest.approx(26650.9e3, abs=100)
    known = np.isfinite(roots)
    assert np.abs(equation.residual(roots, exact, observer)[known]).max() < 1e-9


@pytest.mark.parametrize("j2", [False, True])
def test_no_root_is_overlooked(j2):
    """Against the sign changes on a fine grid, with noise, singular epochs included."""
    noisy, observer, _ = measurements(3, 501, 5, j2)
    equation = RangingEquation(EARTH, j2)
    roots = equation.ranges(noisy, observer)
    grid = np.concatenate([np.linspace(1e2, 8e7, 4000), np.geomspace(8.1e7, 1e11, 400)])
    signs = np.sign(equation.residual(grid, noisy, observer))
    changes = np.count_nonzero(np.diff(signs, axis=-1) != 0, axis=-1)
    within = np.count_nonzero((roots > grid[0]) & (roots < grid[-1]), axis=-1)
    # two roots inside one mesh of 20 km are not seen by the grid
    close = (np.diff(roots, axis=-1) < 20e3).any(axis=-1)
    assert np.array_equal(within[~close], changes[~close])
    assert close.mean() < 0.01 and np.all(within >= changes)


@pytest.mark.parametrize("j2", [False, True])
def test_the_equation_is_that_of_the_vectors(j2):
    """f and its slope, written with the accelerations; also where they are asked for at places of several lines."""
    noisy, observer, _ = measurements(2, 7, 3, j2)
    equation, place = RangingEquation(EARTH, j2), observer[..., None, :3]
    distance = np.geomspace(1e3, 1e9, 60)
    axes = sight_axes(noisy[..., 0], noisy[..., 1])
    e = axes.radial[..., None, :]
    turn = ((noisy[..., 2] * axes.cosine) ** 2 + noisy[..., 3] ** 2)[..., None]

    def pulled(r):
        return np.einsum("...i,...i->...", acceleration(place + r[..., None] * e, EARTH, j2), e)

    own = np.einsum("...i,...i->...", acceleration(place, EARTH, j2), e)
    expected = turn * distance + pulled(distance) - own - noisy[..., 5, None]
    # sums of terms of up to 10 m/s^2 and, far away, of w2 r
    slack = 1e-14 * (10 + turn * distance)
    assert np.all(np.abs(equation.residual(distance, noisy, observer) - expected) < slack)
    dr = 1e-4 * distance
    change = turn + (pulled(distance + dr) - pulled(distance - dr)) / (2 * dr)
    # central differences: 1e-8 of the third derivative, and rounding of 10 m/s^2 over the step
    np.testing.assert_allclose(
        equation.slope(distance, noisy, observer), change, rtol=1e-6, atol=1e-7 * np.abs(change).max()
    )
    several = np.stack([distance, 2 * distance])[:, None, None]
    both = equation.residual(several, noisy, observer)
    np.testing.assert_array_equal(both[1, ..., :], equation.residual(2 * distance, noisy, observer))


@pytest.mark.parametrize("j2", [False, True])
def test_halving_is_step_by_step(j2):
    """To the bit what a loop over arrays makes of the equation; a line with NaN gives NaN and touches no other."""
    noisy, observer, _ = measurements(4, 5, 2, j2)
    noisy[1, 2] = np.nan
    line = RangingEquation(EARTH, j2)._line(noisy, observer)
    low = np.concatenate([line.p - 1e7, line.p + 1e5], axis=-1)
    high, rising = np.add(low, [1e7, 7e7]), np.array([-1.0, 1.0])
    for slope, function in ((False, line.value), (True, line.slope)):
        half = 0.5 * (high - low)
        x = low + half
        for _ in range(52):
            half = 0.5 * half
            x = x - np.copysign(half, function(x) * rising)
        np.testing.assert_array_equal(line.halve(slope, low, high, rising), x)
        assert np.isnan(x[1, 2]).all() and np.isfinite(np.delete(x.reshape(-1, 2), 7, axis=0)).all()


def test_how_many_roots():
    """Not "one to three" as the paper says: f(0) = -r'', so 1 or 3 where r'' > 0 and 0 or 2 where r'' < 0."""
    equation, exact, observer, _, _ = scene()
    count = np.isfinite(equation.ranges(exact, observer)).sum(axis=-1)
    assert np.array_equal(count == 3, TIMES <= 1670) and np.all(count[TIMES > 1670] == 2)
    np.testing.assert_allclose(equation.ranges(exact, observer)[0] / 1e3, [7835.2, 13866.7, 47815.4], atol=0.1)
    noisy, observer, _ = measurements(100, 501, 1)
    found = np.isfinite(equation.ranges(noisy, observer)).sum(axis=-1)
    positive = noisy[..., 5] > 0
    assert np.all(found[positive] % 2 == 1) and np.all(found[~positive] % 2 == 0)
    share = np.bincount(found.ravel(), minlength=4) / found.size
    np.testing.assert_allclose(share, [0.033, 0.009, 0.631, 0.327], atol=0.005)
    good = np.isfinite(equation.candidates(noisy, observer, 100e3)[0]).sum(axis=-1)
    share = np.bincount(good.ravel(), minlength=4) / good.size
    np.testing.assert_allclose(share, [0.042, 0.585, 0.369, 0.004], atol=0.006)


@pytest.mark.parametrize("j2", [False, True])
def test_partials_against_differences(j2):
    equation, exact, observer, _, distance = scene(j2)
    away = np.abs(TIMES - 1805) > 30  # not at the singularity, where a difference is of no use
    exact, observer, distance = exact[away], observer[away], distance[away]
    partials = equation.range_partials(distance, exact, observer)
    assert not partials[:, 4].any()
    for row, step in zip((0, 1, 2, 3, 5), (1e-7, 1e-7, 1e-10, 1e-10, 1e-7), strict=True):
        roots = []
        for sign in (1, -1):
            moved = exact.copy()
            moved[:, row] += sign * step
            found = equation.ranges(moved, observer)
            nearest = np.nanargmin(np.abs(found - distance[:, None]), axis=-1)
            roots.append(found[np.arange(len(nearest)), nearest])
        slope = (roots[0] - roots[1]) / (2 * step)
        np.testing.assert_allclose(partials[:, row], slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max())


def test_the_papers_partials_corrected():
    """(29) to (35) with the corrections of the errata are ours."""
    equation, exact, observer, target, r = scene()
    beta, epsilon, turn, lift = exact[:, :4].T
    ro, rt = np.linalg.norm(observer[:, :3], axis=-1), np.linalg.norm(target[:, :3], axis=-1)
    x, y, z = observer[:, :3].T
    p = np.einsum("ki,ki->k", observer[:, :3], sight_axes(beta, epsilon).radial)
    mu = EARTH.mu
    dm = rt**5 * ((turn * np.cos(epsilon)) ** 2 + lift**2) + 3 * mu * (r + p) ** 2 - mu * rt**2
    nm = mu * (rt**2 - 3 * r * (r + p) - rt**5 / ro**3)
    ce, se, cb, sb = np.cos(epsilon), np.sin(epsilon), np.cos(beta), np.sin(beta)
    expected = np.stack(
        [
            nm / dm * (-x * sb * ce + y * cb * ce),
            2 * r * rt**5 * turn**2 * se * ce / dm + nm / dm * (-x * cb * se - y * sb * se + z * ce),
            -2 * r * rt**5 * turn * ce**2 / dm,
            -2 * r * rt**5 * lift / dm,
            0 * r,
            rt**5 / dm,
        ],
        axis=-1,
    )
    np.testing.assert_allclose(equation.range_partials(r, exact, observer), expected, rtol=1e-8)
    np.testing.assert_allclose(equation.slope(r[:, None], exact, observer)[:, 0], dm / rt**5, rtol=1e-9, atol=1e-19)
    printed = nm / dm * (x * cb * ce - y * sb * ce)  # (29) as it stands
    assert np.median(np.abs(printed / expected[:, 0] - 1)) > 0.1


def test_the_range_is_singular_once():
    equation, exact, observer, _, distance = scene()
    slope = equation.slope(distance[:, None], exact, observer)[:, 0]
    change = TIMES[np.flatnonzero(np.diff(np.sign(slope)))]
    assert np.array_equal(change, [1800.0])
    sigma = np.sqrt(((equation.range_partials(distance, exact, observer) * SIGMAS) ** 2).sum(axis=-1)) / 1e3
    picks = [0, 50, 100, 150, 200, 250, 300, 400, 500]
    np.testing.assert_allclose(sigma[picks], [121, 124, 171, 398, 538, 135, 90, 99, 247], atol=1.0)
    assert np.median(sigma) == pytest.approx(127, abs=1)
    assert np.mean(sigma > 500) == pytest.approx(0.090, abs=0.002)
    shares = np.abs(equation.range_partials(distance, exact, observer)[0]) * SIGMAS / 1e3
    np.testing.assert_allclose(shares[[2, 5, 1, 0, 3]], [88, 80, 17, 15, 4], atol=0.6)


def test_as_printed_the_equation_misses():
    """(23) subtracts the elevation rate's square: 1.26 m/s^2, 25 sigma, in the median; roots are up to 6580 km off."""
    equation, exact, observer, _, distance = scene()
    wrong = -2 * exact[:, 3] ** 2
    printed = equation.residual(distance[:, None], exact, observer)[:, 0] + wrong * distance
    assert np.median(np.abs(printed)) == pytest.approx(1.26, abs=0.02)
    assert np.abs(printed).max() == pytest.approx(4.3, abs=0.1)
    grid = np.linspace(1e4, 6e7, 30001)
    line = equation.residual(grid, exact[::10], observer[::10]) + wrong[::10, None] * grid
    missed = []
    for values, true in zip(line, distance[::10], strict=True):
        at = np.flatnonzero(np.diff(np.sign(values)) != 0)
        roots = grid[at] - values[at] * (grid[1] - grid[0]) / (values[at + 1] - values[at])
        missed.append(np.abs(roots - true).min() if at.size else np.nan)
    missed = np.array(missed) / 1e3
    turning = np.abs(exact[::10, 3]) > 2e-5  # where the elevation stands still the wrong term vanishes
    assert missed[0] == pytest.approx(4.4, abs=0.1) and np.nanmax(missed) == pytest.approx(6580, abs=10)
    assert np.nanmin(missed[turning]) > 4 and np.nanmedian(missed) > 1000


def test_j2_enters_with_a_plus_on_the_right():
    """(58) prints -C1 - C2; the equation that holds has C1 - C2. |C1| <= 4.4e-4, |C2| <= 7.5e-3 m/s^2."""
    _equation, exact, observer, target, distance = scene(True)
    e = sight_axes(exact[:, 0], exact[:, 1]).radial

    def bulge(states):
        place = states[:, :3]
        return np.einsum("ki,ki->k", acceleration(place, EARTH, True) - acceleration(place, EARTH, False), e)

    c1, c2 = bulge(observer), bulge(target)
    assert np.abs(c1).max() == pytest.approx(4.4e-4, rel=0.03) and np.abs(c2).max() == pytest.approx(7.5e-3, rel=0.03)
    plain = RangingEquation(EARTH, False).residual(distance[:, None], exact, observer)[:, 0]
    # plain = left side of (58) minus (r'' - r w2): what is left must be C1 - C2
    assert np.abs(plain - (c1 - c2)).max() < 1e-12
    assert np.abs(plain - (-c1 - c2)).max() == pytest.approx(2 * np.abs(c1).max(), rel=1e-6)


def test_a_target_without_acceleration_is_a_contrast():
    """(11): far off for a satellite, exact for a body in straight motion."""
    equation, exact, observer, _, distance = scene()
    assert np.median(np.abs(equation.naive_range(exact, observer) / distance - 1)) > 0.2
    offset, velocity = np.array([3e6, -4e6, 5e6]), np.array([-2e3, 1e3, 500.0])
    r = np.linalg.norm(offset)
    u = offset / r
    level2 = offset[0] ** 2 + offset[1] ** 2
    lift = (np.sqrt(level2) * velocity[2] - offset[2] * (offset[:2] @ velocity[:2]) / np.sqrt(level2)) / r**2
    turn = (offset[0] * velocity[1] - offset[1] * velocity[0]) / level2
    own = acceleration(observer[0, :3], EARTH, False)
    rate = u @ velocity
    row = [np.arctan2(offset[1], offset[0]), np.arcsin(u[2]), turn, lift, rate]
    row.append((velocity @ velocity - rate**2) / r - u @ own)
    assert equation.naive_range(np.array(row), observer[0]) == pytest.approx(r, rel=1e-12)


@pytest.mark.parametrize("j2", [False, True])
def test_states_and_their_jacobian(j2):
    equation, exact, observer, target, distance = scene(j2)
    np.testing.assert_allclose(equation.states(distance, exact, observer), target, rtol=0, atol=1e-5)
    jacobian = equation.state_jacobian(distance, exact, observer)
    steps = [1e-7, 1e-7, 1e-10, 1e-10, 1e-2, 1e-7]
    for k in (0, 120, 240, 450):
        which = np.nanargmin(np.abs(equation.ranges(exact[k], observer[k]) - distance[k]))
        for row, step in enumerate(steps):
            ends = []
            for sign in (1, -1):
                moved = exact[k].copy()
                moved[row] += sign * step
                ends.append(equation.states(equation.ranges(moved, observer[k])[which], moved, observer[k]))
            slope = (ends[0] - ends[1]) / (2 * step)
            np.testing.assert_allclose(jacobian[k, :, row], slope, rtol=2e-6, atol=1e-6 * np.abs(slope).max())


def test_the_covariance_is_that_of_the_errors():
    """4000 draws at a tenth of the noise, where the equation is linear: spread and correlation, 5 sigma of sampling."""
    equation, exact, observer, target, distance = scene()
    draws, k = 4000, 20
    noisy = exact[k] + 0.1 * SIGMAS * np.random.default_rng(7).standard_normal((draws, 6))
    roots = equation.ranges(noisy, observer[k])
    chosen = roots[np.arange(draws), np.nanargmin(np.abs(roots - distance[k]), axis=-1)]
    error = equation.states(chosen, noisy, observer[k]) - target[k]
    expected = equation.state_covariance(distance[k], exact[k], observer[k], 0.1 * SIGMAS)
    scale = np.sqrt(np.diag(expected))
    sample = (error / scale).T @ (error / scale) / draws
    assert np.abs(sample - expected / np.outer(scale, scale)).max() < 5 * np.sqrt(2 / draws)
    np.testing.assert_array_equal(
        equation.position_covariance(distance[k], exact[k], observer[k], SIGMAS),
        equation.state_covariance(distance[k], exact[k], observer[k], SIGMAS)[:3, :3],
    )
    # what (46) to (49) leave out: without the correlation of range and angles
    jacobian, axes = equation.state_jacobian(distance[k], exact[k], observer[k])[:3], sight_axes(*exact[k, :2])
    apart = jacobian - np.outer(axes.radial, axes.radial @ jacobian)
    without = (apart * SIGMAS) @ (apart * SIGMAS).T
    along = ((axes.radial @ jacobian) * SIGMAS) ** 2
    without += along.sum() * np.outer(axes.radial, axes.radial)
    full = equation.position_covariance(distance[k], exact[k], observer[k], SIGMAS)
    assert np.abs(without - full).max() > 0.01 * np.abs(full).max()


def test_the_position_model_knows_its_covariance():
    observer, target = arc(times=TIMES[:3])
    model = RangedPosition(sensor())
    equation, exact = model.equation, sensor().predict(target, observer[:, None])
    distance = np.linalg.norm((target - observer)[:, :3], axis=-1)
    expected = equation.position_covariance(distance, exact, observer, SIGMAS)
    np.testing.assert_allclose(model.noise_covariance_at(target, observer[:, None]), expected, rtol=1e-9)
    with pytest.raises(ValueError, match="ranging needs all rows"):
        ranging_equation(RelativeKinematics({"azimuth": 1e-3}, EARTH))


def test_missing_rows_give_no_root_and_touch_no_other():
    noisy, observer, _ = measurements(4, 1, 2)
    equation = RangingEquation(EARTH)
    whole = equation.ranges(noisy[:, 0], observer[0])
    for row in (0, 1, 2, 3, 5):
        gap = noisy[:, 0].copy()
        gap[1, row] = np.nan
        roots = equation.ranges(gap, observer[0])
        assert np.isnan(roots[1]).all()
        np.testing.assert_array_equal(roots[[0, 2, 3]], whole[[0, 2, 3]])


def test_lines_that_do_not_turn_or_pass_the_centre_do_no_harm():
    observer, target = arc(times=TIMES[:1])
    exact = sensor().predict(target, observer[:, None])[0]
    still = exact.copy()
    still[2:4] = 0.0
    for j2 in (False, True):
        roots = RangingEquation(EARTH, j2).ranges(still, observer[0])
        assert roots.shape == (3,)
    down = -observer[0, :3] / np.linalg.norm(observer[0, :3])
    inward = exact.copy()
    inward[:2] = np.arctan2(down[1], down[0]), np.arcsin(down[2])
    roots, _ = RangingEquation(EARTH).candidates(inward, observer[0], 100e3)
    assert roots.shape == (3,)
