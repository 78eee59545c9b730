"""How long an instant waits follows how late its clouds are."""

import numpy as np
import pytest

from services.mapper.patience import Patience

pytestmark = pytest.mark.unit


def lived(lateness_s: list[list[float]], least_s: float = 0.1, most_s: float = 0.5) -> Patience:
    patience = Patience(least_s, most_s)
    for tick, each in enumerate(lateness_s):
        for late_s in sorted([0.0, *each]):
            patience.note(tick, tick + late_s)
    return patience


def test_nobody_waits_longer_than_asked_for_while_all_come_together() -> None:
    assert Patience(0.1, 0.5).wait_s == 0.1
    assert lived([[0.001, 0.02]] * 50).wait_s == 0.1


def test_it_waits_for_whoever_comes_late_and_a_little_more() -> None:
    rng = np.random.default_rng(0)
    patience = lived([[0.01, late] for late in rng.uniform(0.15, 0.25, 60)])
    assert 0.25 < patience.wait_s < 0.25 * 1.3


def test_it_never_waits_longer_than_allowed() -> None:
    assert lived([[3.0]] * 10).wait_s == 0.5
    assert lived([[3.0]] * 10, least_s=2.0, most_s=0.5).wait_s == 2.0


def test_what_was_late_long_ago_is_forgotten() -> None:
    assert lived([[0.4]] + [[0.01]] * 200).wait_s == 0.1


def test_it_remembers_a_bounded_number_of_instants() -> None:
    patience = lived([[0.01]] * 2000)
    assert len(patience._began_s) <= 128
    assert len(patience._late_s) <= 128


def test_another_run_does_not_count_from_the_one_before() -> None:
    patience = Patience(0.1, 0.5)
    for run_s in (0.0, 50.0):
        for tick in range(40):
            patience.note(tick, run_s + tick)
            patience.note(tick, run_s + tick + 0.01)
    assert patience.wait_s == 0.1
