"""Whom a session lets in, and as whom it goes in itself."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from services.runtime.access import access_control
from services.runtime.errors import BusUnavailable
from services.runtime.roles import roles
from services.runtime.settings import BusSettings


@dataclass(frozen=True)
class Guard:
    """What zenoh is told of it."""

    options: dict[str, Any] = field(default_factory=dict)
    """Paths of its configuration and their values."""
    is_tls: bool = False

    def link(self, endpoint: str) -> str:
        """Return the endpoint as it is reached: with certificates by TLS only."""
        return endpoint.replace("tcp/", "tls/", 1) if self.is_tls else endpoint


def guarding(settings: BusSettings, address: str) -> Guard:
    """Return the guard that the settings ask for.

    Args:
        settings: of the session.
        address: `service` or `service/instance`.

    Raises:
        BusUnavailable: If a file is missing; the text names it and what makes it.
    """
    options: dict[str, Any] = {}
    if settings.user or settings.users_file is not None:
        users = settings.users_file
        options["transport/auth/usrpwd"] = {
            "user": settings.user or None,
            "password": settings.password.get_secret_value() or None,
            "dictionary_file": None if users is None else str(_there(users, "lines user:password")),
        }
    if settings.certs is None:
        return Guard(options)
    role = settings.role or address
    options["transport/link/tls"] = _tls(settings.certs, role)
    options["access_control"] = access_control(roles())
    return Guard(options, is_tls=True)


def file_name(role: str) -> str:
    """Return the name of a role's files, without the ending."""
    return role.replace("/", "-")


def _tls(folder: Path, role: str) -> dict[str, Any]:
    command = f"encircle certs issue {folder} {role}"
    certificate = str(_there(folder / f"{file_name(role)}.pem", command))
    key = str(_there(folder / f"{file_name(role)}.key", command))
    return {
        "root_ca_certificate": str(_there(folder / "ca.pem", f"encircle certs init {folder}")),
        "enable_mtls": True,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def _there(path: Path, remedy: str) -> Path:
    if not path.is_file():
        raise BusUnavailable(f"{path} is not there; {remedy}")
    return path
