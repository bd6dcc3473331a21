"""Models stated once, symbolically; ``python -m models`` writes them as C."""
