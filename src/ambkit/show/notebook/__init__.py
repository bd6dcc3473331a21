"""What a notebook shows of each object."""
