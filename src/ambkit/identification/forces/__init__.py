"""Forces that were measured: on a grid from the loop, as points from a bench, at lift-off."""
