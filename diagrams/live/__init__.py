"""Measurements that come one by one, at once or in real time: lines in, estimates out, tick by tick."""
