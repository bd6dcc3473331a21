"""What was measured: the record, and how a rig's log of any format becomes one.

A simulated run is a record too. Nothing here knows of bearings.
"""
