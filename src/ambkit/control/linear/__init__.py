"""The linearised loop: plant, controller and estimator as linear systems."""
