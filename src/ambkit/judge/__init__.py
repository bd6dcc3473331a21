"""How good an estimator is: by the truth, its bound and others, through faults, on a record."""
