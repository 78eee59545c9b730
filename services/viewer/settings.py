"""How the viewer is told what to do."""

from typing import Annotated

from pydantic import Field, SecretStr

from services.runtime.settings import ServiceSettings
from services.viewer.voxels import MAX_DRAWN


class ViewerSettings(ServiceSettings):
    """Show the run in a browser, and steer it from there."""

    model_config = ServiceSettings.model_config | {"env_prefix": "ENCIRCLE_VIEWER_"}

    port: Annotated[int, Field(ge=1, le=65535)] = 8080
    """Where the page is served; the next free one when it is taken."""
    host: str = "127.0.0.1"
    """Address to serve on; beyond this machine (`0.0.0.0`) only with a token."""
    token: SecretStr = SecretStr("")
    """Asked of every browser: http://HOST:PORT/?token=...; 16 characters at least. Better from the
    environment (ENCIRCLE_VIEWER_TOKEN) than as a flag."""
    insecure: bool = False
    """Serve beyond this machine without a token: whoever reaches the page can steer."""
    rate_hz: Annotated[float, Field(gt=0, le=30)] = 8.0
    """Frames per second, at most."""
    max_points: Annotated[int, Field(ge=100, le=2_000_000)] = MAX_DRAWN
    """Voxels drawn at most; all are counted."""
    dark: bool = False
    """Begin in dark colours."""
