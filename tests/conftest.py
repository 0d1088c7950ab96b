"""What all tests share: random tests have no time limit, as the first call of a kernel compiles it."""

from hypothesis import settings

settings.register_profile("wsp", deadline=None)
settings.load_profile("wsp")
