"""Geometry that measurement models share: lines of sight, light time, body axes, visibility, refraction."""
