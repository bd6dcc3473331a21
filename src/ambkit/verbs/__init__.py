"""The verbs of ambkit: functions in Python, from which the commands are made.

This package has signatures and docstrings only, and imports nothing heavy, so that the help of a
command appears immediately.
"""
