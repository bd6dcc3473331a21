"""Controllers as data: blocks, gains, synthesis, and the linear loop for their margins."""
