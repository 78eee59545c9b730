"""Which keys are meant: zenoh's key expressions, applied to keys."""

from collections.abc import Sequence

import zenoh

from services.runtime.errors import BadExpression


def parse(expression: str) -> zenoh.KeyExpr:
    """Return a key expression.

    Raises:
        BadExpression: If it is none.
    """
    try:
        return zenoh.KeyExpr(expression)
    except zenoh.ZError as error:
        raise BadExpression(
            f"key expression {expression!r}: {str(error).split(' at /')[0]}; `*` is one part of "
            "a key, `**` any number of parts, e.g. 'cams/*/pose'"
        ) from None


class KeyFilter:
    """Tells whether a key matches any of some expressions; remembers what it has told."""

    def __init__(self, expressions: Sequence[str]) -> None:
        """Parse them.

        Raises:
            BadExpression: If one is none.
        """
        self._expressions = [parse(expression) for expression in expressions]
        self._known: dict[str, bool] = {}

    def __call__(self, key: str) -> bool:
        """Whether `key` is meant."""
        if key not in self._known:
            concrete = parse(key)
            self._known[key] = any(each.includes(concrete) for each in self._expressions)
        return self._known[key]
