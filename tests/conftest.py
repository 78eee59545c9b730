"""The same drawn examples in every run, so that what is red is red for everybody.

`HYPOTHESIS_PROFILE=explore pytest tests/unit` draws others each time.

Tests of live sessions and real processes wait for others on a machine that others may use, too:
one that fails is tried once more, and pytest's closing line counts it as rerun. Pure tests are not.
"""

import os
from collections.abc import Iterable

import pytest
from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("explore", max_examples=500, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

_LIVE = ("integration", "e2e", "docker")


def pytest_collection_modifyitems(config: pytest.Config, items: Iterable[pytest.Item]) -> None:
    if not config.pluginmanager.hasplugin("rerunfailures"):
        return
    for item in items:
        if any(item.get_closest_marker(name) for name in _LIVE):
            item.add_marker(pytest.mark.flaky(reruns=1))
