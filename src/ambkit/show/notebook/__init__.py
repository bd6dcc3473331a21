"""What a notebook shows of each object: a small table, and a picture."""

from ambkit.show.notebook.card import Card

__all__ = ["Card"]
