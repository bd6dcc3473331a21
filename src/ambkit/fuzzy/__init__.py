"""The expert: a fuzzy network for the stiffnesses, and its training on a map."""
