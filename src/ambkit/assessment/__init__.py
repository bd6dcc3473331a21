"""Stability margins of a closed loop: linear, by amplitude, over speed, from a log."""
