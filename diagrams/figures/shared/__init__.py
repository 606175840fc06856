"""What all figures share: their manner, colours and groups, where axes end, names beside places, views of a frame.

May import: diagrams.quantities.
"""
