"""Compiled parts of the ranging equation."""
