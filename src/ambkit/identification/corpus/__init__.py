"""Many logs of one rig: segmented, identified one by one, pooled, and cross-validated."""
