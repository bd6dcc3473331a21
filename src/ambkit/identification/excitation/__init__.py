"""Design of experiments: signals that excite a machine in its loop, within limits."""

from ambkit.identification.excitation.design import Design, Limits, design

__all__ = ["Design", "Limits", "design"]
