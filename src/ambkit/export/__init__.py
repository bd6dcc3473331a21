"""From the trained filter to the controller: the library's own C, with its data, wrapped.

``c`` writes a folder of C that compiles alone; what else wraps the same C builds on it.
"""
