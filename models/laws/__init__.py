"""Force laws of the magnets, one file each: stated once, tangents derived, written as C."""

from models.laws.closed import closed
from models.laws.saturating import saturating

LAWS = (closed, saturating)
