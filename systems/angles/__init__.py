"""Measurement models of directions: bearings, azimuth and elevation, direction of arrival, phases."""
