"""The linearised loop: plant, controller and estimator, its sensitivity, margins and limits."""
