"""From TOML with units to checked, frozen models; every problem with its file and line."""

from ambkit.base.config.document import Document, Part, Read, read_unchecked, reader

__all__ = ["Document", "Part", "Read", "read_unchecked", "reader"]
