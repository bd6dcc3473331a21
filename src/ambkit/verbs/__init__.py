"""What ambkit does, one verb a function: Python calls them, and the commands are made from them.

Signatures and docstrings stand here, the work in the rooms below. Nothing here imports anything
heavy, so that the help of a command appears at once.
"""
