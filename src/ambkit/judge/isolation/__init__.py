"""Fault isolation: which fault explains the innovations of a filter."""
