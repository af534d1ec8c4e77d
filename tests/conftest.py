"""What every test shares: property tests that draw the same examples in every run and are never timed."""

from hypothesis import settings

settings.register_profile("optik", deadline=None, derandomize=True, database=None, max_examples=60)
settings.load_profile("optik")
