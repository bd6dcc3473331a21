"""Reading of a rig's logs: contents, defects, and the conversion to a record."""

from ambkit.data.reading.clock import Clock
from ambkit.data.reading.faults import Channel, Fault
from ambkit.data.reading.reader import Reading, load, load_with_gaps, read
from ambkit.data.reading.rejections import RejectedLog

__all__ = ["Channel", "Clock", "Fault", "Reading", "RejectedLog", "load", "load_with_gaps", "read"]
