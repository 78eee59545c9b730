"""What can go wrong between services."""


class RuntimeFault(Exception):
    """Base of this package's errors."""


class BusUnavailable(RuntimeFault):
    """The session could not be opened; the text names the endpoint and the rule."""


class NoReply(RuntimeFault):
    """Nobody answered a request in time."""


class CommandFailed(RuntimeFault):
    """A service answered a request with an error; its text is the service's own."""


class BadCommand(RuntimeFault):
    """A request's parameters are wrong; the text names value, rule and choices."""


class SettingsRefused(RuntimeFault):
    """A service cannot be built from its settings; a restart would not mend it."""


class MissingExtra(RuntimeFault):
    """An optional dependency is not installed; the text says which to install."""


class BadExpression(RuntimeFault, ValueError):
    """A key expression that zenoh does not take; the text names it."""
