"""Whole pages: the report on an identification, and on a comparison."""
