"""The C core in single precision: the same names as ``ambkit._core``."""

from ambkit._core import *
