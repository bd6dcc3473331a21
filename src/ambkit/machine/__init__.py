"""The machine: its parts in TOML with units, force laws and measured forces, presets.

The paper's bearing is a preset; `ambkit.machine.paper` has its numbers.
"""
