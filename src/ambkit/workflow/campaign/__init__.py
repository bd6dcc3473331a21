"""Many machines, each drawn from what varies: here or on a cluster, kept, judged and searched."""
