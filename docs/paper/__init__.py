"""The chapters of `ambkit reproduce`: one module a chapter, in the order of the report."""
