"""Designing an experiment: signals that excite a bearing in its loop, within limits."""

from ambkit.identification.excitation.design import Design, Limits, design

__all__ = ["Design", "Limits", "design"]
