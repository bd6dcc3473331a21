"""Many machines sampled from tolerances: simulated here or on a cluster, stored, evaluated."""
