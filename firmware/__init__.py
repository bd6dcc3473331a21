"""An exported filter on a Cortex-M4F without hardware: see README.md."""
