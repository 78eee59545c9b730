"""The same drawn examples in every run, so that what is red is red for everybody.

`HYPOTHESIS_PROFILE=explore pytest tests/unit` draws others each time.
"""

import os

from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("explore", max_examples=500, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))
