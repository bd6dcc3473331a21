"""A magnet from its drawing: geometry, mesh, nonlinear magnetostatic field, force map."""
