"""Sensor blocks: truth in, measurements out; and recorded measurements in their place."""
