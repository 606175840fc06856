"""Messages of the Consultative Committee for Space Data Systems: tracking data, ephemerides.

May import: diagrams.readers, diagrams.schema, systems, systems.earth.
"""
