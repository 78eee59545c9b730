"""What can go wrong in planning."""


class PlannerError(ValueError):
    """Base of the planner's errors; the text names the value, the rule and the choices."""


class ViewFileError(PlannerError):
    """A view file that cannot be read; the text names file and line."""


class UnknownSettingError(PlannerError):
    """A live change of something that cannot be changed."""


class InfeasibleError(PlannerError):
    """A formation that cannot be driven; the text names the inequality and what would do."""
