"""The command ``ambkit``: arguments and texts; the rooms below do the work.

One module each command; they are imported when they are called for.
"""
