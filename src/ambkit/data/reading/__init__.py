"""Reading a rig's logs: what is in them, what is wrong with them, and a record out of them."""

from ambkit.data.reading.clock import Clock
from ambkit.data.reading.faults import Channel, Fault
from ambkit.data.reading.reader import Reading, load, load_filled, read
from ambkit.data.reading.rejections import Refused

__all__ = ["Channel", "Clock", "Fault", "Reading", "Refused", "load", "load_filled", "read"]
