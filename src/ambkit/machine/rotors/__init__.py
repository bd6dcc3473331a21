"""Flexible rotors: their beams, matrices and modes."""
