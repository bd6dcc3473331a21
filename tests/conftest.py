"""Settings of all tests."""

from hypothesis import settings

# A busy machine must not fail a test: what must be fast is measured in benchmarks/.
settings.register_profile("ambkit", deadline=None)
settings.load_profile("ambkit")
