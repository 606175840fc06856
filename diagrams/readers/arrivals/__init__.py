"""What a recording of arrival times is made of as text: cells, names of columns, identifiers.

May import: diagrams.schema, systems.
"""
