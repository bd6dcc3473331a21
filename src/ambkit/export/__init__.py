"""Export of filters and controllers: C, FMU, MATLAB; and of the plant for python-control.

``c`` writes a folder of the library's own C that compiles alone; ``fmu`` wraps the same C.
"""
