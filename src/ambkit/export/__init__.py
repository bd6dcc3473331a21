"""Export of filters and controllers: C, FMU, MATLAB; and of the plant for python-control.

``c`` writes a folder with the library's C that compiles on its own; ``fmu`` wraps the same C.
"""
