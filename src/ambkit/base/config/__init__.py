"""From TOML with units to checked, frozen models; every problem with its file and line."""

from ambkit.base.config.document import Document, Part, Read, read_unchecked, reader
from ambkit.base.config.problems import unknown_key

__all__ = ["Document", "Part", "Read", "read_unchecked", "reader", "unknown_key"]
