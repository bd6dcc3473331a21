"""Online identification of the magnet constant, sample by sample."""
