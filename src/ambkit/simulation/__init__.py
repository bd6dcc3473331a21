"""The loop: a scenario's signals and controller, the nonlinear plant, an estimator in between.

It stands above the estimators, one of which closes the loop, and the signals stand with it, for
nothing below asks what disturbs a run.
"""
