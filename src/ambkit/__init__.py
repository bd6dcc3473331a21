"""Adaptive Kalman filters for active magnetic bearings."""
