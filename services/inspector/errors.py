"""What can go wrong in looking at the bus."""


class InspectorError(Exception):
    """Base of this package's errors; the text is for the user and says what to do."""


class UnknownField(InspectorError):
    """A message has no such field; the text names the fields that there are."""
