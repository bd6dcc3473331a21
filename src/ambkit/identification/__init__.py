"""Identification of parameters from records, in batch or online, and the design of experiments."""
