"""Parameters from records, all at once or sample by sample, and the experiments that tell them."""
