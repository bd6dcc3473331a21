"""Forces that a record tells: on a grid from the loop, or at lift-off."""
