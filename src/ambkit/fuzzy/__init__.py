"""The expert: a fuzzy network that gives the stiffnesses, and its training from a map."""
