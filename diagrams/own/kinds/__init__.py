"""Kinds of measurement of a system of one's own, a file each; `quietfix.diagrams.own.fields.sensors` lists them."""
