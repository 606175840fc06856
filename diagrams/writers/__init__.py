"""Files for other programs to read: each format a function from data to text.

May import: diagrams.quantities, diagrams.readers, diagrams.schema, diagrams.statistics, systems, systems.earth.
"""
