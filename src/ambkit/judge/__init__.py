"""Judgement of estimators: by truth and its bound, with faults, on records, in the loop."""
