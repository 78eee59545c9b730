"""`encircle certs`, as it is typed: what it signs is checked by the library that others use."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from services.launcher.cli import dispatch

pytestmark = pytest.mark.unit

x509 = pytest.importorskip("cryptography.x509", reason="encircle[security] is not installed")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    assert dispatch(["certs", "init", str(tmp_path / "certs")]) == 0
    return tmp_path / "certs"


def read(path: Path):
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_a_certificate_names_its_role_and_hosts_and_is_signed_by_the_authority(folder) -> None:
    asked = ["camera/3", "--host", "192.168.1.7", "--host", "ring-3.local", "--days", "30"]
    assert dispatch(["certs", "issue", str(folder), *asked]) == 0
    made, authority = read(folder / "camera-3.pem"), read(folder / "ca.pem")
    made.verify_directly_issued_by(authority)
    assert made.subject.rfc4514_string() == "CN=camera/3"
    names = made.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    addresses = {str(address) for address in names.get_values_for_type(x509.IPAddress)}
    assert addresses == {"127.0.0.1", "::1", "192.168.1.7"}
    assert set(names.get_values_for_type(x509.DNSName)) == {"localhost", "ring-3.local"}
    left = made.not_valid_after_utc - datetime.now(UTC)
    assert timedelta(days=29) < left <= timedelta(days=30)
    assert not made.extensions.get_extension_for_class(x509.BasicConstraints).value.ca


def test_keys_are_their_owners_alone(folder) -> None:
    assert dispatch(["certs", "issue", str(folder), "--cameras", "2"]) == 0
    keys = sorted(folder.glob("*.key"))
    assert {"ca.key", "camera-0.key", "camera-1.key", "mapper.key"} <= {key.name for key in keys}
    assert {key.stat().st_mode & 0o777 for key in keys} == {0o600}
    assert folder.stat().st_mode & 0o777 == 0o700
    assert len({key.read_bytes() for key in keys}) == len(keys)


def test_an_authority_is_not_overwritten(folder, capsys) -> None:
    before = (folder / "ca.key").read_bytes()
    assert dispatch(["certs", "init", str(folder)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (folder / "ca.key").read_bytes() == before


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["camera/64"], "no role 'camera/64'; known: router"),
        (["camera"], "no role 'camera'"),
        ([], "name the roles, or --cameras"),
    ],
)
def test_what_is_no_role_is_refused_with_the_choices(folder, capsys, asked, said) -> None:
    assert dispatch(["certs", "issue", str(folder), *asked]) == 2
    assert said in capsys.readouterr().err
    assert list(folder.glob("camera*")) == []


def test_without_an_authority_the_command_that_makes_one_is_named(tmp_path, capsys) -> None:
    assert dispatch(["certs", "issue", str(tmp_path), "mapper"]) == 2
    assert f"encircle certs init {tmp_path}" in capsys.readouterr().err
