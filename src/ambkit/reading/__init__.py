"""Reading a rig's logs: what is in them, what is wrong with them, and a record out of them."""

from ambkit.reading.clock import Clock
from ambkit.reading.faults import Channel, Fault
from ambkit.reading.reader import Reading, load, read
from ambkit.reading.refusals import Refused

__all__ = ["Channel", "Clock", "Fault", "Reading", "Refused", "load", "read"]
