"""`encircle certs`: an authority, and a certificate for every role."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from schemas.camera import MAX_CAMERAS
from services.launcher.errors import MissingExtraError, SettingsError
from services.runtime.guard import file_name
from services.runtime.roles import SINGLES, roles

_HERE = ("localhost", "127.0.0.1", "::1")


def certs(args: Sequence[str]) -> int:
    """Carry out `encircle certs`, say what was made and return the exit code.

    Raises:
        SettingsError: If a role is unknown or the folder is not usable.
        MissingExtraError: If cryptography is not installed.
    """
    asked = _parser().parse_args(args)
    try:
        from services.launcher import authority
    except ImportError as error:
        raise MissingExtraError(
            f"encircle certs needs {error.name}; pip install 'encircle[security]'"
        ) from error
    try:
        if asked.verb == "init":
            made = authority.create(asked.folder, asked.days)
            print(f"{made}; next: encircle certs issue {asked.folder} --cameras 6")
            return 0
        wanted = _wanted(asked.roles, asked.cameras)
        for role in wanted:
            authority.issue(asked.folder, role, file_name(role), (*_HERE, *asked.host), asked.days)
    except OSError as error:
        raise SettingsError(f"{asked.folder}: {error.strerror}") from error
    print(
        f"{asked.folder}: {', '.join(wanted)}; give a host ca.pem and the .pem and .key of its own "
        "roles, never ca.key"
    )
    return 0


def _wanted(named: Sequence[str], cameras: int | None) -> tuple[str, ...]:
    """Return the roles to sign for: those named, or all of a ring of so many cameras.

    Raises:
        SettingsError: If a name is no role, or none is given.
    """
    known = {role.name for role in roles()}
    for name in named:
        if name not in known:
            choices = f"{', '.join(SINGLES)}, camera/0 .. camera/{MAX_CAMERAS - 1}"
            raise SettingsError(f"no role {name!r}; known: {choices}")
    whole = () if cameras is None else tuple(role.name for role in roles(cameras))
    if not named and not whole:
        raise SettingsError("name the roles, or --cameras N for all of a ring of N")
    return tuple(dict.fromkeys((*named, *whole)))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="encircle certs", description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    init = verbs.add_parser("init", help="make an authority: ca.pem, and ca.key, which stays here")
    issue = verbs.add_parser("issue", help="sign certificates for roles")
    for verb, days in ((init, 3650), (issue, 365)):
        verb.add_argument("folder", type=Path)
        verb.add_argument("--days", type=_positive, default=days, help=f"valid for [{days}]")
    issue.add_argument("roles", nargs="*", metavar="ROLE", help="e.g. mapper, camera/0, operator")
    issue.add_argument("--cameras", type=_cameras, help="all roles of a ring of so many")
    issue.add_argument(
        "--host", action="append", default=[], help="a name or address it is reached at; repeat"
    )
    return parser


def _positive(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) <= 36500:
        raise argparse.ArgumentTypeError(f"{text!r} must be 1..36500 days")
    return int(text)


def _cameras(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) <= MAX_CAMERAS:
        raise argparse.ArgumentTypeError(f"{text!r} must be 1..{MAX_CAMERAS}")
    return int(text)
