"""Foundations of all rooms: errors, units, TOML with units, files, text."""
