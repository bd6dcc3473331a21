"""Magnet forces from records: on a grid from closed-loop records, or at lift-off."""
