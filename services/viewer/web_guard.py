"""The door in front of viser's server, which has none: for pages and for websockets."""

import http
import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from services.viewer.admission import Admission, Admitted, Welcomed

logger = logging.getLogger(__name__)

_LOG_PERIOD_S = 10.0  # A flood of strangers is one line each.
_serving = threading.Lock()


class GuardMissing(RuntimeError):
    """Viser serves otherwise than we know: nothing would ask for the token."""


class WebGuard:
    """Asks `Admission` about every request, before viser sees it."""

    def __init__(self, admission: Admission) -> None:
        self._admission = admission
        self._logged_s = -_LOG_PERIOD_S
        self._num_doors = 0
        self.num_refused = 0

    @contextmanager
    def before_servers(self) -> Iterator[None]:
        """Stand before the server that is begun within the block.

        Viser hands `websockets` the function that answers each request, on a thread of its own,
        and offers no place for another; so `serve` is exchanged while viser begins. If it then
        was not called, the block ends in an error and nothing may be left serving.

        Raises:
            GuardMissing: If no server was begun, or not in this way.
        """
        import websockets.asyncio.server as server  # Comes with viser.

        original = server.serve

        def serve(*args: Any, **options: Any) -> Any:
            answer = options.get("process_request") or (lambda *_: None)
            options["process_request"] = self._before(answer)
            self._num_doors += 1
            return original(*args, **options)

        with _serving:
            server.serve = serve  # type: ignore[assignment, misc]
            try:
                yield
            finally:
                server.serve = original  # type: ignore[misc]
        if not self._num_doors:
            raise GuardMissing("viser did not begin its server by websockets.asyncio.server.serve")

    def _before(self, answer: Callable[..., Any]) -> Callable[..., Any]:
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        def process_request(connection: Any, request: Any) -> Any:
            # A header that is sent twice is one too many: which would be believed?
            headers = {name: ", ".join(request.headers.get_all(name)) for name in request.headers}
            verdict = self._admission.judge(request.path, headers)
            if isinstance(verdict, Admitted):
                return answer(connection, request)
            told = Headers({"Cache-Control": "no-store", "Referrer-Policy": "no-referrer"})
            if isinstance(verdict, Welcomed):
                told["Location"], told["Set-Cookie"] = verdict.location, verdict.cookie
                told["Content-Length"] = "0"
                return Response(http.HTTPStatus.SEE_OTHER, "See Other", told, b"")
            self._note(connection, verdict.reason)
            body = f"{verdict.reason}\nOpen /?token=... as it was told to you.\n".encode()
            told["Content-Type"] = "text/plain; charset=utf-8"
            told["Content-Length"] = str(len(body))
            return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", told, body)

        return process_request

    def _note(self, connection: Any, reason: str) -> None:
        self.num_refused += 1
        now_s = time.monotonic()
        if now_s - self._logged_s < _LOG_PERIOD_S:
            return
        self._logged_s = now_s
        whence = (connection.remote_address or ("?",))[0]
        logger.warning("refused %s: %s (%d so far)", whence, reason, self.num_refused)
