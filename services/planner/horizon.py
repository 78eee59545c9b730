"""The best of many courses over a receding horizon, and never one from which there is no way back.

Every course that is taken ends at rest where the sharpest turn is safe, so that its rest can be
kept when nothing better is found: with a forecast that comes true, what was feasible once stays so.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.kernels.circle_rules import LATE
from services.kernels.rigid import FloatArray
from services.planner.menu import NUM_STEPS, Menu
from services.planner.quintic import Course

BoolArray = NDArray[np.bool_]

SLACK_RAD = 2e-3
"""A new course stays so far from the limits, unless the safe place does not either: between two
instants it may bulge."""
TOUCHING_RAD = 1e-6
_WORTH_CHANGING = 1e-3
"""Of the value: for less the former course is kept."""
_RULES, _RETURN = 1e9, 1e6
"""What a broken rule, and an end where one cannot stay, weigh more than all that is wished for."""
_TRIES = 4
_AT_ONCE = 6
"""So many quantities are looked at in an instant; the others go on, and have their turn. It bounds
what an instant costs."""


@dataclass(frozen=True)
class Rated:
    """What is thought of C courses of M quantities; arrays (C, M)."""

    worth: FloatArray
    """The more the better."""
    fault: FloatArray
    """How badly a rule is broken; 0 if all are kept."""


Rows = NDArray[np.intp]


class Rules(Protocol):
    """What courses over a horizon are held against; `rows` are the quantities meant."""

    def held(self, values: FloatArray, rates: FloatArray, rows: Rows) -> FloatArray:
        """Return by how much (K, M) values and rates break a rule; negative where it is kept."""
        ...

    def worth(self, values: FloatArray, rows: Rows) -> FloatArray:
        """Return (M,) what (K, M) values are worth."""
        ...

    def rated(
        self,
        table: FloatArray,
        known: FloatArray,
        allowed: FloatArray,
        least: FloatArray,
        rows: Rows,
    ) -> Rated:
        """Rate the courses of a menu.

        Args:
            table: of the menu.
            known: (5, M) what its entries are in terms of.
            allowed: (K, M) how far the rules may be broken.
            least: (M,) nan, or who has a course that keeps the rules: what another must be worth
                more than. Of one that is not, or breaks rules, nothing else is asked: its fault
                is infinite.
            rows: (M,)
        """
        ...


Verify = Callable[[Course, Rows], BoolArray]
"""Which of some of the courses keep the rules that are too costly to hold all against."""


def replan(
    courses: Menu,
    t_s: float,
    turn: int,
    former: Course,
    safe: FloatArray,
    ideal: FloatArray,
    rules: Rules,
    verify: Verify | None = None,
) -> Course:
    """Return what M quantities do from now on, continuing what they did.

    Args:
        courses: to choose from.
        t_s: now.
        turn: counts the instants: whose turn it is.
        former: what they have done until now, and would do.
        safe: (M,) values that keep all rules at rest for ever.
        ideal: (M,) values that are wished for.
        rules: that courses are held against.
        verify: the same, for what is about to be taken.
    """
    # Whether going on as planned still will do, and what standing safe would be like.
    rows = _whose_turn(len(safe), turn)
    mine = former.of(rows)
    tail = mine.at(t_s + courses.after_s)
    over = np.maximum(rules.held(tail[0], tail[1], rows) - TOUCHING_RAD, 0.0)
    fault = over.mean(axis=0)
    fault[fault > 0] += np.where(over[-1] > 0, LATE, 1.0)[fault > 0]
    strays = mine.safe != safe[rows]
    still = np.tile(safe[rows], (NUM_STEPS, 1))
    allowed = np.maximum(-SLACK_RAD, np.minimum(rules.held(still, 0 * still, rows), 0.0))

    # What each course is worth, rules before wishes; the best that can be driven.
    known = np.concatenate([mine.at(t_s), safe[None, rows], ideal[None, rows]])
    worth = rules.worth(tail[0], rows)
    worth += _WORTH_CHANGING * np.maximum(1.0, np.abs(worth))
    least = np.where(fault > 0, np.nan, np.where(strays, -np.inf, worth))
    rated = rules.rated(courses.table, known, allowed + TOUCHING_RAD, least, rows)
    score = np.concatenate(
        [
            _scores(rated.worth, rated.fault, courses.ends_safe[:, None]),
            _scores(worth, fault, ~strays)[None],
        ]
    )
    rest = len(score) - 1
    course = former
    for _ in range(_TRIES):
        picked = np.argmax(score, axis=0)
        new = np.flatnonzero(picked != rest)
        course = (
            former
            if len(new) == 0
            else _taken(courses, picked[new], rows[new], former, t_s, known[:, new])
        )
        if len(new) == 0 or verify is None or (can := verify(course, rows[new])).all():
            return course
        score[picked[new[~can]], new[~can]] = -np.inf
    # Not all that was tried will do: who found nothing goes on as before.
    failed = rows[new[~can]]
    return course.replaced(failed, former.of(failed))


def _whose_turn(num: int, turn: int) -> Rows:
    """Return who is looked at."""
    chosen: Rows = np.unique((turn * _AT_ONCE + np.arange(min(num, _AT_ONCE))) % num)
    return chosen


def _scores(worth: FloatArray, fault: FloatArray, ends_safe: BoolArray) -> FloatArray:
    """Return what is best first: keeps the rules and ends where it can stay, is worth most."""
    score: FloatArray = np.where(
        fault > 0, -_RULES * fault, worth - np.where(ends_safe, 0.0, _RETURN)
    )
    return score


def _taken(
    courses: Menu, row: Rows, whose: Rows, former: Course, t_s: float, known: FloatArray
) -> Course:
    """Return the courses that were picked for some as one; the others go on.

    Args:
        courses: to choose from.
        row: (M',) those that were picked.
        whose: (M',) for which quantities.
        former: courses of all M.
        t_s: now.
        known: (5, M') value, rate, acceleration, safe and ideal value.
    """
    goal = (courses.goal[row] * known[[0, 1, 3, 4]].T).sum(axis=1)
    value, rate, push, safe, _ = known
    picked = Course(
        np.full_like(goal, t_s),
        value,
        rate,
        push,
        goal,
        safe,
        courses.move_s[row],
        courses.leave_s[row],
        courses.back_s[row],
    )
    return former.replaced(whose, picked)
