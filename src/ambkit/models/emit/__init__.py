"""Straight-line C from a model's pattern, with the interface of ``ambkit/model.h``: unrolled loops.

One text serves float, double and SIMD lanes. Structural ones need no product; sums have the order
of the loops, so that the bits agree.
"""

from ambkit.models.emit.header import constants, fields, header, initialiser
from ambkit.models.emit.names import KEYWORDS, Names, Naming

__all__ = ["KEYWORDS", "Names", "Naming", "constants", "fields", "header", "initialiser"]
