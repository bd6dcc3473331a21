"""Controllers as data: blocks, gains, synthesis, and the linear loop they are judged by."""
