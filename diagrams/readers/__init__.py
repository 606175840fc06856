"""Files that others made: bearings, Doppler, arrival times, I/Q, flights.

May import: diagrams.readers.arrivals, diagrams.schema, systems, systems.angles, systems.earth, systems.plants,
systems.trajectories.
"""
