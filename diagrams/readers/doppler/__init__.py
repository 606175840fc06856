"""Files about one satellite that is heard: two-line elements, received frequencies, where the station is.

May import: diagrams.readers, diagrams.schema, systems, systems.earth.
"""
