"""The loop within its limits: plant, controller and estimator as linear systems."""
