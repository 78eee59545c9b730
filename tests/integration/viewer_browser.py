"""What a browser says to viser and is told by it, without a browser: its wire format, decoded."""

import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from viser._messages import GuiUpdateMessage, Message, ShareUrlRequest, ViewerCameraMessage
from websockets.sync.client import ClientConnection, connect

TIMEOUT_S = 20.0
_CAMERA = ViewerCameraMessage(
    wxyz=(1.0, 0.0, 0.0, 0.0),
    position=(1.0, 1.0, 1.0),
    fov=1.0,
    near=0.01,
    far=100.0,
    image_height=600,
    image_width=800,
    look_at=(0.0, 0.0, 0.0),
    up_direction=(0.0, 0.0, 1.0),
)


class Browser:
    """One connection; `until` waits for what the page is told."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self.controls: dict[str, str] = {}
        """Label to uuid, of all inputs that were told."""
        self._waiting: deque[dict[str, Any]] = deque()
        self.send(_CAMERA)

    def send(self, message: Message) -> None:
        """Say something, as the page's script would."""
        self._connection.send(msgspec.msgpack.encode(message.as_serializable_dict()))

    def set(self, label: str, value: Any) -> None:
        """Change an input."""
        self.send(GuiUpdateMessage(self.controls[label], {"value": value}))

    def ask_to_share(self) -> None:
        """Ask for viser's outside relay."""
        self.send(ShareUrlRequest())

    def until(self, wanted: Callable[[dict[str, Any]], Any]) -> Any:
        """Return the first true answer of `wanted` to a message; arrays are decoded."""
        deadline_s = time.monotonic() + TIMEOUT_S
        while True:
            while self._waiting:
                message = self._waiting.popleft()
                label = message.get("props", {}).get("label")
                if isinstance(label, str) and "uuid" in message:
                    self.controls[label] = message["uuid"]
                if answer := wanted(message):
                    return answer
            self._waiting.extend(self._next(deadline_s - time.monotonic()))

    def _next(self, timeout_s: float) -> list[dict[str, Any]]:
        raw = self._connection.recv(timeout_s)
        assert isinstance(raw, bytes)
        size = int.from_bytes(raw[8:16], "little")
        packed = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size])
        told = msgspec.msgpack.decode(packed)
        at, arrays = 16 + size, []
        for length in told["binaryBufferLengths"]:
            at += -at % 8
            arrays.append(raw[at : at + length])
            at += length
        return [_with_arrays(message, arrays) for message in told["messages"]]


def _with_arrays(value: Any, arrays: list[bytes]) -> Any:
    if isinstance(value, dict):
        if "__binary_index" in value:
            return np.frombuffer(arrays[value["__binary_index"]], value["dtype"])
        return {key: _with_arrays(each, arrays) for key, each in value.items()}
    if isinstance(value, list):
        return [_with_arrays(each, arrays) for each in value]
    return value


@contextmanager
def browsing(port: int) -> Iterator[Browser]:
    """Open the page."""
    with connect(
        f"ws://127.0.0.1:{port}",
        subprotocols=[f"viser-v{viser.__version__}"],
        compression=None,
        max_size=None,
    ) as connection:
        yield Browser(connection)


@contextmanager
def stalled(port: int) -> Iterator[socket.socket]:
    """Open the page and never read again: the kernel's buffers fill, then the server's."""
    with socket.socket() as plain:
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        plain.connect(("127.0.0.1", port))
        plain.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
            "Sec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Protocol: viser-v{viser.__version__}\r\n\r\n".encode()
        )
        assert b"101" in plain.recv(64)
        payload = msgspec.msgpack.encode(_CAMERA.as_serializable_dict())
        # A binary frame, masked by zeros (RFC 6455, 5.2).
        plain.sendall(b"\x82\xfe" + len(payload).to_bytes(2, "big") + bytes(4) + payload)
        yield plain
