"""Simulation of the closed loop: scenario, controllers, nonlinear plant, estimator.

It stands above the estimators, one of which closes the loop, and the signals stand with it, for
nothing below asks what disturbs a run.
"""
