"""Recorded measurements in the place of a simulated sensor."""
