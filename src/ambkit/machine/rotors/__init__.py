"""Rotors that bend: their beams, matrices and modes."""
