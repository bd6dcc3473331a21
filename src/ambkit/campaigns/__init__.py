"""Many machines sampled from their tolerances: here or on a cluster, stored and judged."""
