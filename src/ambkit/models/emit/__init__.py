"""From a model's pattern to straight-line C: the same sums as the core's loops, unrolled.

What is written is what ``ambkit/model.h`` asks of a model. The covariance is its upper triangle,
row by row. There are no branches but those between several forces or sensors, so one text serves
float, double and SIMD lanes. An entry that is one by structure costs no product. The order of the
sums is that of the loops, so that the bits agree.
"""

from ambkit.models.emit.header import constants, fields, header, initialiser
from ambkit.models.emit.names import KEYWORDS, Names, Naming

__all__ = ["KEYWORDS", "Names", "Naming", "constants", "fields", "header", "initialiser"]
