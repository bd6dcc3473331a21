"""Any model in single precision: the same names as ``ambkit._any``."""

from ambkit._any import *
