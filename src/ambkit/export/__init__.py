"""From the trained filter to the controller: C, FMUs, MATLAB, and the plant for python-control.

``c`` writes a folder of the library's own C that compiles alone; ``fmu`` wraps the same C.
"""
