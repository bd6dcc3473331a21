"""The command ``ambkit``: arguments and texts; the rooms below do the work.

One module per command, imported when needed.
"""
