"""Settings that every service has: default < environment < flag; nobody else reads these."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict


class BusSettings(BaseSettings):
    """How a service joins the bus."""

    model_config = SettingsConfigDict(
        env_prefix="ENCIRCLE_BUS_", frozen=True, use_attribute_docstrings=True
    )

    connect: str = "tcp/127.0.0.1:7447"
    """Endpoint of the router, tried until it answers; empty for none."""
    listen: str = "tcp/127.0.0.1:0"
    """Where other services reach this one; port 0 takes a free one, empty for nowhere."""
    namespace: str = ""
    """Put before every key on the wire, so that several deployments share a router."""
    shm_pool_mib: Annotated[int, Field(ge=0, le=4096)] = 32
    """Shared memory for what this service sends, MiB; 0 sends everything over the network."""
    certs: Path | None = None
    """Folder with ca.pem and <role>.pem, <role>.key (`encircle certs`). Every link is then TLS with
    both sides proven, `tcp/` means `tls/`, and nobody says or reads beyond its role."""
    role: str = ""
    """Whose certificate of that folder; of this service if empty, `operator` to steer."""
    user: str = ""
    """Name that the others ask for, if they have a list of users."""
    password: SecretStr = SecretStr("")
    """Its password; better from the environment (ENCIRCLE_BUS_PASSWORD) than as a flag."""
    users_file: Path | None = None
    """Whom this service lets in: lines `user:password`."""


class ServiceSettings(BaseSettings):
    """Base of every service's settings."""

    model_config = SettingsConfigDict(
        frozen=True, use_attribute_docstrings=True, extra="forbid", validate_default=True
    )

    bus: BusSettings = Field(default_factory=BusSettings)
    """How to join the bus."""
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    """Least severe level that is logged."""

    def joining(self) -> BusSettings:
        """Return how to join the bus, all considered."""
        return self.bus

    def instance(self) -> str | None:
        """Name of this instance among several of the service; None for an only one."""
        return None
