"""Workflows behind the commands: identify, train, tune, design, simulate, filter, compare."""
