"""Force laws of the magnets, one file each: stated once, tangents derived, written as C."""

from derivation.laws.closed import closed
from derivation.laws.saturating import saturating

LAWS = (closed, saturating)
