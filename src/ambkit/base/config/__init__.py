"""Validation of TOML with units into frozen models; every error with file and line."""

from ambkit.base.config.document import Document, Part, Read, read_unchecked, reader
from ambkit.base.config.problems import unknown_key

__all__ = ["Document", "Part", "Read", "read_unchecked", "reader", "unknown_key"]
