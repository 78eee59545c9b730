"""The target's filter: the truth is found, the doubt is honest, bad input is borne."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.planner.target_filter import Fix, TargetFilter, motion_of
from services.planner.turn_model import Agility, moved, wrap

pytestmark = pytest.mark.unit

AGILITY = Agility(0.1, 0.3)
DT_NS = 66_666_667
DT_S = DT_NS * 1e-9


def new_filter(agility=AGILITY, bridge_s=1.0):
    return TargetFilter(agility, bridge_s)


def fix(t_ns, state, sigma_m=0.0, sigma_rad=0.0):
    x, y, phi = (float(part) for part in state[:3])
    return Fix(t_ns, x, y, sigma_m, phi, sigma_rad)


def arc(num, start=(1.0, -2.0, 3.0, 0.4, 0.5)):
    """Return num states of a target of constant speed and turn rate, one per tick."""
    return [moved(np.array(start), tick * DT_S)[0] for tick in range(num)]


def noisy(states, seed, sigma_m=0.02, sigma_rad=0.006):
    noise = np.random.default_rng(seed).normal(size=(len(states), 3))
    noise *= [sigma_m, sigma_m, sigma_rad]
    return [
        fix(tick * DT_NS, state[:3] + off, sigma_m, sigma_rad)
        for tick, (state, off) in enumerate(zip(states, noise, strict=True))
    ]


def error(belief, state):
    gap = belief.mean - state
    gap[2] = wrap(gap[2])
    return gap


def filtered(fixes, **settings):
    found = new_filter(**settings)
    for each in fixes:
        found.add(each)
    return found


@pytest.mark.parametrize(
    ("v", "omega"), [(0.4, 0.5), (0.4, 0.0), (0.0, 0.0), (0.0, 0.7), (-0.3, 0.2), (2.0, -2.0)]
)
def test_without_noise_the_truth_is_found(v, omega):
    states = arc(150, (1.0, -2.0, 3.0, v, omega))
    found = filtered([fix(tick * DT_NS, state) for tick, state in enumerate(states)])
    np.testing.assert_allclose(error(found.at(149 * DT_NS), states[-1]), 0, atol=1e-5)
    assert found.num_refused == 0


def random_run(seed, num=90):
    """Return the states of a target whose accelerations are as the filter thinks."""
    rng, state, states = np.random.default_rng(seed), None, []
    state = np.concatenate([rng.uniform(-3, 3, 3), rng.normal(size=2)])
    fine = 5
    for _ in range(num):
        states.append(state)
        for _ in range(fine):
            state, _ = moved(state, DT_S / fine)
            kick = rng.normal(size=2) * np.sqrt(DT_S / fine)
            state = state + np.array([0, 0, 0, AGILITY.linear * kick[0], AGILITY.angular * kick[1]])
    return states


def test_the_doubt_is_honest():
    """Normalised estimation error squared; Bar-Shalom, Li, Kirubarajan, 2001, sect. 5.4.2."""
    runs, num = 40, 90
    squares = np.empty((runs, num))
    for run in range(runs):
        states, found = random_run(run, num), new_filter()
        for tick, each in enumerate(noisy(states, [9, run], 0.05, 0.02)):
            found.add(each)
            belief = found.at(tick * DT_NS)
            gap = error(belief, states[tick])
            squares[run, tick] = gap @ np.linalg.solve(belief.cov, gap)
    # The sum over runs is chi-square with 200 degrees of freedom: 95 % within 162.7 and 241.1.
    sums = squares[:, 5:].sum(axis=0)
    assert np.mean((sums > 162.7) & (sums < 241.1)) > 0.85
    # All times together, as if five ticks apart were independent.
    assert squares[:, 5:].mean() == pytest.approx(5, rel=4 * np.sqrt(2 / (5 * runs * 17)))


def test_the_noise_is_reduced():
    states = arc(300)
    found, fixes = new_filter(), noisy(states, 3)
    errors = []
    for tick, each in enumerate(fixes):
        found.add(each)
        errors.append(error(found.at(tick * DT_NS), states[tick]))
    place, heading = np.array(errors)[50:, :2], np.array(errors)[50:, 2]
    assert np.sqrt(np.mean(place**2)) < 0.75 * 0.02
    assert np.sqrt(np.mean(heading**2)) < 0.006


def test_a_delay_is_made_up_for():
    states = arc(200)
    delay = 1.5 * DT_S  # 100 ms.
    found, after, before = new_filter(), [], []
    for tick in range(20, 200):
        seen_ns = tick * DT_NS - round(delay * 1e9)
        seen, _ = moved(states[0], seen_ns * 1e-9)
        found.add(fix(seen_ns, seen))
        after.append(error(found.at(tick * DT_NS), states[tick]))
        before.append(np.hypot(*(seen - states[tick])[:2]))
    assert min(before) > 0.03
    assert np.abs(after[60:]).max() < 1e-3


def test_half_a_second_without_measurements_is_bridged():
    states = arc(120)
    found = filtered(noisy(states, 5, 0.005, 0.003)[:100])
    later = found.at(round((99 * DT_S + 0.5) * 1e9))
    truth, _ = moved(states[99], 0.5)
    assert np.hypot(*error(later, truth)[:2]) < 0.03
    assert np.hypot(*(truth - states[99])[:2]) > 0.19
    # The doubt grows, and what comes then is taken in.
    assert later.cov[0, 0] > 2 * found.at(99 * DT_NS).cov[0, 0]
    found.add(noisy(states, 5, 0.005, 0.003)[106])
    assert found.num_refused == 0


def test_who_is_lost_for_long_stands_and_is_found_anew_wherever_it_is():
    states = arc(100)
    found = filtered(noisy(states, 6))
    end, later = found.at(99 * DT_NS + 10**9), found.at(99 * DT_NS + 10**11)
    np.testing.assert_array_equal(later.mean, [*end.mean[:3], 0, 0])
    found.add(fix(99 * DT_NS + 10**11, (50.0, 50.0, 1.0), 0.02, 0.006))
    assert found.num_refused == 0
    np.testing.assert_allclose(found.at(99 * DT_NS + 10**11).mean, [50, 50, 1, 0, 0])


def test_a_target_that_stops_turns_on_the_spot_and_goes_back_is_followed():
    state, states = np.array([0.0, 0.0, 0.0, 0.0, 0.0]), []
    for tick in range(400):  # Drive 0.4 m/s, stop, turn at 0.5 rad/s, reverse at 0.2 m/s.
        phase = tick // 100
        want = [(0.4, 0.0), (0.0, 0.0), (0.0, 0.5), (-0.2, 0.2)][phase]
        state[3:] += np.clip(want - state[3:], -0.5 * DT_S, 0.5 * DT_S)
        states.append(state.copy())
        state, _ = moved(state, DT_S)
    found, errors = new_filter(), []
    for tick, each in enumerate(noisy(states, 21)):
        found.add(each)
        errors.append(error(found.at(tick * DT_NS), states[tick]))
    assert found.num_refused == 0
    assert np.hypot(*np.array(errors)[:, :2].T).max() < 0.07
    settled = np.array([e for tick, e in enumerate(errors) if tick % 100 > 60])
    assert np.abs(settled[:, 3]).max() < 0.12


def test_outliers_are_refused_and_change_nothing():
    fixes = noisy(arc(100), 7)
    wild = list(fixes)
    for tick in (40, 41, 60, 90):
        wild[tick] = fix(tick * DT_NS, (9.0, 9.0, 0.0), 0.02, 0.006)
    found = filtered(wild)
    assert found.num_refused == 4
    without = filtered([each for tick, each in enumerate(fixes) if tick not in (40, 41, 60, 90)])
    np.testing.assert_allclose(found.at(99 * DT_NS).mean, without.at(99 * DT_NS).mean, atol=2e-3)


def test_honest_measurements_are_hardly_ever_refused():
    refused = sum(filtered(noisy(random_run(seed), seed)).num_refused for seed in range(10))
    assert refused <= 2


def test_a_target_that_was_carried_away_is_found_again():
    found = filtered(noisy(arc(50), 8))
    for tick in range(50, 60):
        found.add(fix(tick * DT_NS, (9.0, 9.0, 0.5), 0.02, 0.006))
    assert found.num_refused == 5
    np.testing.assert_allclose(found.at(59 * DT_NS).mean[:3], [9, 9, 0.5], atol=0.02)


@settings(max_examples=40)
@given(st.permutations(range(1, 20)), st.sampled_from([0.0, 0.3]))
def test_the_order_in_which_measurements_come_does_not_matter(order, outliers):
    fixes = noisy(arc(20), 11)
    wild = np.random.default_rng(1).random(20) < outliers
    for tick in np.flatnonzero(wild[1:]) + 1:
        fixes[tick] = fix(tick * DT_NS, (9.0, 9.0, 0.0), 0.02, 0.006)
    one, other = filtered(fixes), filtered([fixes[0]] + [fixes[tick] for tick in order])
    for mine, yours in zip(one.at(20 * DT_NS), other.at(20 * DT_NS), strict=True):
        np.testing.assert_array_equal(mine, yours)
    assert one.num_refused == other.num_refused


def test_a_measurement_told_twice_counts_once():
    fixes = noisy(arc(20), 12)
    one, other = filtered(fixes), filtered([each for each in fixes for _ in range(3)])
    np.testing.assert_array_equal(one.at(19 * DT_NS).mean, other.at(19 * DT_NS).mean)
    assert (one.num_used, other.num_used, other.num_repeated) == (20, 20, 40)


def test_what_is_older_than_all_that_is_remembered_is_ignored():
    fixes = noisy(arc(60), 13)
    found = filtered(fixes[:5] + fixes[6:])
    before = found.at(59 * DT_NS).mean
    found.add(fixes[5])
    assert found.num_late == 1
    np.testing.assert_array_equal(found.at(59 * DT_NS).mean, before)


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 3 * 10**9), st.floats(0, 5)), min_size=1, max_size=50))
def test_whatever_the_stamps_the_belief_is_a_distribution(steps):
    found, t_ns, rng = new_filter(), 0, np.random.default_rng(2)
    for step_ns, sigma in steps:
        t_ns += step_ns
        found.add(fix(t_ns, rng.normal(size=3), sigma, sigma))
        for ahead_ns in (0, 10**8, 10**10):
            belief = found.at(t_ns + ahead_ns)
            assert np.isfinite(belief.mean).all()
            assert np.linalg.eigvalsh(belief.cov).min() > 0


def test_before_the_first_measurement_nothing_is_known():
    assert new_filter().at(0) is None
    assert new_filter().newest_ns is None


def test_a_belief_is_a_frame_that_moves():
    found = filtered([fix(tick * DT_NS, state) for tick, state in enumerate(arc(150))])
    belief = found.at(149 * DT_NS)
    motion = motion_of(belief)
    phi, v, omega = belief.mean[2:]
    np.testing.assert_allclose(motion.T[:2, 3], belief.mean[:2])
    np.testing.assert_allclose(motion.linear, [v * np.cos(phi), v * np.sin(phi), 0])
    np.testing.assert_allclose(motion.angular, [0, 0, omega])
