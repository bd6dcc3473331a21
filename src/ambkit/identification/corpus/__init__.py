"""Many logs of one rig at once: cut, identified one by one, pooled, each judged by the others."""
