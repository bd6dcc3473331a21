"""What every room stands on and none is about: errors, units, TOML with units, files, text."""
