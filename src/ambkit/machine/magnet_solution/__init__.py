"""What follows from the field of a magnet: stiffnesses, limits, errors of laws, pictures."""
