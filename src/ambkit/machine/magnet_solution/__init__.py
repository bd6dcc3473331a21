"""Results of a magnet's field: stiffnesses, limits, errors of force laws, figures."""
