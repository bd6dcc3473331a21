"""Models stated once, symbolically; ``python -m derivation`` writes them as C."""
