"""The command ``ambkit``: arguments and words. What a command does, the rooms below do.

One module each command; they are imported when they are called for.
"""
