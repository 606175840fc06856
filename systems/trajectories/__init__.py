"""Motion by laws of nature or by a plan, as pure functions: gravity, Kepler, great circles, waypoints, rockets.

May import: systems, systems.earth.
"""
