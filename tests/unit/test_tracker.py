"""The simulated tracker: noisy, late, forgetful, and the same for the same seed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.settings import SimulatorSettings
from services.simulator.tracker import Tracker
from services.world.path import open_motion

pytestmark = pytest.mark.unit

MOTION = open_motion("ellipse", (1.6, 1.2), 40.0)
DT_NS = 66_666_667


def tracker(**settings):
    perfect = {"noise_m": 0.0, "noise_rad": 0.0, "delay_ns": 0, "dropout": 0.0, "seed": 0}
    return Tracker(**(perfect | settings))


def sightings(watcher, num_ticks):
    told = [watcher.observation(MOTION, tick, tick * DT_NS) for tick in range(num_ticks)]
    return [each.sighting for each in told]


def heading(sighting):
    T = sighting.pose.matrix()
    return np.arctan2(T[1, 0], T[0, 0])


@given(st.integers(0, 10_000))
def test_a_perfect_tracker_tells_the_truth_of_now(tick):
    told = tracker().observation(MOTION, tick, tick * DT_NS)
    assert (told.tick, told.t_ns, told.sighting.t_ns) == (tick, tick * DT_NS, tick * DT_NS)
    truth = MOTION.at(tick * DT_NS * 1e-9)
    np.testing.assert_allclose(told.sighting.pose.matrix(), truth.pose(), atol=1e-12)


@given(st.integers(0, 3_000_000_000), st.integers(0, 100))
def test_what_is_told_is_as_old_as_the_delay_and_the_target_stood_before_the_start(delay_ns, tick):
    told = tracker(delay_ns=delay_ns).observation(MOTION, tick, tick * DT_NS)
    assert told.sighting.t_ns == max(tick * DT_NS - delay_ns, 0)
    truth = MOTION.at(told.sighting.t_ns * 1e-9)
    np.testing.assert_allclose(told.sighting.pose.matrix(), truth.pose(), atol=1e-12)


def test_one_measurement_told_twice_is_the_same_whenever_it_is_told():
    noisy = tracker(noise_m=0.1, noise_rad=0.1, delay_ns=5 * DT_NS)
    before_the_delay_has_passed = sightings(noisy, 6)
    assert len(set(map(str, before_the_delay_has_passed))) == 1
    assert sightings(noisy, 50) == sightings(noisy, 50)


def test_another_seed_is_another_noise_and_other_losses():
    one, other = (sightings(tracker(noise_m=0.1, dropout=0.5, seed=seed), 50) for seed in (1, 2))
    assert [each is None for each in one] != [each is None for each in other]
    assert not {str(each) for each in one if each} & {str(each) for each in other if each}


def test_the_noise_has_the_deviations_that_are_told():
    found = sightings(tracker(noise_m=0.02, noise_rad=0.006), 4000)
    truths = [MOTION.at(each.t_ns * 1e-9) for each in found]
    off = [
        np.subtract(each.pose.position[:2], t.position_m)
        for each, t in zip(found, truths, strict=True)
    ]
    turned = [heading(each) - t.heading_rad for each, t in zip(found, truths, strict=True)]
    turned = np.angle(np.exp(1j * np.array(turned)))
    # The deviation of a deviation over n samples is sigma / sqrt(2 n): four of them.
    assert np.std(off, axis=0) == pytest.approx([0.02, 0.02], rel=4 / np.sqrt(8000))
    assert np.std(turned) == pytest.approx(0.006, rel=4 / np.sqrt(8000))
    assert np.abs(np.mean(off, axis=0)).max() < 4 * 0.02 / np.sqrt(4000)
    assert {(each.sigma_m, each.sigma_rad) for each in found} == {(0.02, 0.006)}


@pytest.mark.parametrize("dropout", [0.0, 0.2, 1.0])
def test_so_many_are_lost(dropout):
    lost = [each is None for each in sightings(tracker(dropout=dropout), 2000)]
    assert np.mean(lost) == pytest.approx(dropout, abs=4 * np.sqrt(dropout * (1 - dropout) / 2000))


def test_noise_does_not_change_what_is_lost():
    one, other = (sightings(tracker(dropout=0.5, noise_m=noise), 100) for noise in (0.0, 1.0))
    assert [each is None for each in one] == [each is None for each in other]


def test_the_settings_describe_a_tracker():
    settings = SimulatorSettings(
        target_noise_m=0.02,
        target_noise_rad=0.006,
        target_delay_s=0.1,
        target_dropout=0.25,
        seed=7,
    )
    assert settings.tracker() == Tracker(0.02, 0.006, 100_000_000, 0.25, 7)
