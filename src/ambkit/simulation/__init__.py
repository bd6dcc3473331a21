"""Simulation of the closed loop: scenario, controllers, nonlinear plant, estimator.

This package is above the estimators, because one of them closes the loop.
"""
