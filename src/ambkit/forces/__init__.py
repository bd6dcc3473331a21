"""A force that was measured or computed, point by point, and the surface through it."""
