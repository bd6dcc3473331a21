"""The machine: its parts in TOML with units, force laws and measured forces, presets.

The paper's bearing is one of them, and `ambkit.machine.paper` has its numbers.
"""
