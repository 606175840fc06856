"""Five systems of a user's own written out by hand: geometry, orbits, rows, derivatives and motion; none of it ours."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

C, MU, RADIUS, J2, RATE = 299_792_458.0, 3.986004418e14, 6_378_137.0, 1.0826261e-3, 7.292115e-5
ECCENTRICITY2 = 6.69437999014e-3  # of WGS 84, squared


# ------------------------------------------------------------------------------------------------ where things are


def on_the_ellipsoid(latitude, longitude, height):
    """State (6,) of a place in Earth-fixed axes [m, m/s]."""
    b, l = np.radians([latitude, longitude])  # noqa: E741
    normal = RADIUS / np.sqrt(1 - ECCENTRICITY2 * np.sin(b) ** 2)
    across = (normal + height) * np.cos(b)
    z = (normal * (1 - ECCENTRICITY2) + height) * np.sin(b)
    return np.array([across * np.cos(l), across * np.sin(l), z, 0, 0, 0])


def height_of(place):
    """Height over the ellipsoid [m], by fixed-point iteration of the latitude."""
    across = np.hypot(place[..., 0], place[..., 1])
    b = np.arctan2(place[..., 2], across * (1 - ECCENTRICITY2))
    for _ in range(8):
        normal = RADIUS / np.sqrt(1 - ECCENTRICITY2 * np.sin(b) ** 2)
        b = np.arctan2(place[..., 2] + ECCENTRICITY2 * normal * np.sin(b), across)
    normal = RADIUS / np.sqrt(1 - ECCENTRICITY2 * np.sin(b) ** 2)
    return across * np.cos(b) + place[..., 2] * np.sin(b) - normal * (1 - ECCENTRICITY2 * np.sin(b) ** 2)


def orbit(axis, inclination, node=0.0, latitude=0.0, j2=J2):
    """States (time, 6) of a circular orbit in Earth-fixed axes, as a function of times; Cowell's method with J2."""
    plane = Rotation.from_euler("ZXZ", [node, inclination, latitude], degrees=True)
    begin = np.concatenate([plane.apply([axis, 0, 0]), plane.apply([0, np.sqrt(MU / axis), 0])])

    def fall(t, state):
        place = state[:3]
        r = np.linalg.norm(place)
        flattened = 1.5 * j2 * (RADIUS / r) ** 2 * (np.array([1.0, 1.0, 3.0]) - 5 * (place[2] / r) ** 2)
        return np.concatenate([state[3:], -MU / r**3 * place * (1 + flattened)])

    def states(times):
        found = solve_ivp(fall, (0, times[-1]), begin, "DOP853", times, rtol=1e-12, atol=1e-6).y.T
        turn = Rotation.from_euler("z", -RATE * np.asarray(times)[:, None])
        place = turn.apply(found[:, :3])
        return np.hstack([place, turn.apply(found[:, 3:]) - np.cross([0, 0, RATE], place)])

    return states


def at_rest(state):
    return lambda times: np.tile(state, (len(times), 1))


def east_north_up(east_km, north_km, up_m):
    return at_rest(np.array([east_km * 1e3, north_km * 1e3, up_m, 0, 0, 0]))


# --------------------------------------------------------------------------------------- what is measured, of a state


def distance(x, platform):
    return np.sqrt(((x[..., :3] - platform[..., :3]) ** 2).sum(-1))


def rate(x, platform):
    offset = x[..., :3] - platform[..., :3]
    return (offset * (x[..., 3:6] - platform[..., 3:])).sum(-1) / np.sqrt((offset**2).sum(-1))


def delays(reference, *receivers):
    return {
        f"tdoa_{r}_{reference}": lambda x, p, r=r: (distance(x, p[r]) - distance(x, p[reference])) / C
        for r in receivers
    }


def shifts(reference, carrier, *receivers):
    return {
        f"fdoa_{r}_{reference}": lambda x, p, r=r: -carrier / C * (rate(x, p[r]) - rate(x, p[reference]))
        for r in receivers
    }


def azimuth(x, p):
    return np.arctan2(x[..., 1] - p["alpha"][..., 1], x[..., 0] - p["alpha"][..., 0])


STATIONS = [(38.6, 111.9, 1200), (38.4, 110.6, 1000), (37.4, 112.6, 800), (36.4, 109.9, 600), (35.0, 112.4, 500)]
STATIONS += [(33.6, 109.3, 400), (31.4, 111.6, 300)]
GEO = 42_164_169.6

# Of each file: its platforms, the rows, their sigmas, density of the acceleration [m^2/s^3], variance that the bias
# gains per second [m^2/s^3], sigmas of the start.
DRONE = {
    "platforms": {
        "alpha": east_north_up(-8, -5, 30),
        "bravo": east_north_up(9, -4, 120),
        "charlie": east_north_up(1, 9, 60),
        "delta": east_north_up(0, 0, 5),
    },
    "rows": delays("delta", "alpha", "bravo", "charlie")
    | {"azimuth_alpha": azimuth, "altitude": lambda x, p: x[..., 2]},
    "sigmas": [30e-9] * 3 + [np.radians(0.5), 30],
    "density": 1.0,
    "start": [800] * 3 + [30] * 3,
}
SHIP = {
    "platforms": {"east": orbit(7_078_000, 60), "west": orbit(7_078_000, 60, 1.0, -0.7)},
    "rows": shifts("west", 1626e6, "east") | {"altitude": lambda x, p: height_of(x)},
    "sigmas": [1.0, 20],
    "density": 1e-4,
    "start": [30_000] * 3 + [6] * 3,
}
HERTZ = C / 401.65e6  # [m/s]
BEACON = {
    "platforms": {"satellite": orbit(6_978_000, 82, 10, 30)},
    "rows": {
        "frequency_satellite": lambda x, p: -(rate(x, p["satellite"]) + x[..., 6]) / HERTZ,
        "altitude": lambda x, p: height_of(x),
    },
    "sigmas": [2.0, 50],
    "density": 1e-9,
    "walk": 0.01 * HERTZ**2,
    "start": [50_000] * 3 + [0.1] * 3 + [1500 * HERTZ],
}
GEOSTATIONARY = {
    "platforms": {
        "a": orbit(GEO, 0.05, 0, 10, j2=0),
        "b": orbit(GEO, 0.02, 0, 16, j2=0),
        "c": orbit(GEO, 0.08, 40, -35, j2=0),
    },
    "rows": delays("a", "b", "c") | shifts("a", 6e9, "b", "c") | {"altitude": lambda x, p: height_of(x)},
    "sigmas": [200e-9] * 2 + [0.02] * 2 + [200],
    "density": 1e-8,
    "start": [20_000] * 3 + [0.1] * 3,
}
ROCKET = {
    "platforms": {f"s{i + 1}": at_rest(on_the_ellipsoid(*place)) for i, place in enumerate(STATIONS)},
    "rows": {f"range_rate_s{i}": lambda x, p, i=i: rate(x, p[f"s{i}"]) + x[..., 6] for i in range(1, 8)},
    "sigmas": [0.03] * 7,
    "density": 30.0,
    "walk": 0.5 * (C / 2200e6) ** 2,
    "start": [200] * 3 + [5] * 3 + [1600 * C / 2200e6],
}
SYSTEMS = {
    "drone.yaml": DRONE,
    "ship.yaml": SHIP,
    "beacon.yaml": BEACON,
    "geostationary.yaml": GEOSTATIONARY,
    "rocket.yaml": ROCKET,
}


# ---------------------------------------------------------------------------------------------------- the recursion


def gradient(row, state, platforms):
    """Derivative (trials, n) of a row by five points 10 m, 1 m/s apart; off by (10 m / distance)^4."""
    n = state.shape[-1]
    sizes = np.array([10.0] * 3 + [1.0] * (n - 3))

    def difference(step):
        ahead, behind = (row(state[:, None] + sign * step * np.diag(sizes), platforms) for sign in (1, -1))
        return (ahead - behind) / (2 * step * sizes)

    return (4 * difference(1) - difference(2)) / 3


def moved(covariance, dt, density, walk):
    """P after dt of straight flight that white noise disturbs; Q by Simpson's rule, exact for a quadratic."""
    n = covariance.shape[-1]
    phi = np.eye(n, dtype=np.longdouble)
    phi[:3, 3:6] = dt * np.eye(3)
    noise = np.zeros((n, n), dtype=np.longdouble)
    for at, weight in ((0, 1), (dt / 2, 4), (dt, 1)):
        effect = np.zeros((n, 3))
        effect[:3], effect[3:6] = at * np.eye(3), np.eye(3)
        noise += weight * dt / 6 * density * effect @ effect.T
    noise[6:, 6:] += walk * dt
    return phi @ covariance @ phi.T + noise
