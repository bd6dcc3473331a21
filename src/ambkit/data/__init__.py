"""Measured and simulated records, and the reading of logs in any format."""
