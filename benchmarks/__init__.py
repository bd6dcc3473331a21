"""How fast ambkit is, beside other ways to do the same work; see README.md in this folder."""
