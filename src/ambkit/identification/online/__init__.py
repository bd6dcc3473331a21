"""The magnet constant, learned sample by sample as a controller would."""
