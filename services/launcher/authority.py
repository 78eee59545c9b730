"""A certificate authority of one's own: a key that never leaves its folder, and what it signs.

Elliptic curve P-256, X.509 v3; Source: RFC 5280, and cryptography's own builder.
"""

import ipaddress
import os
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from services.launcher.errors import SettingsError

_CLOCK_SKEW = timedelta(minutes=10)
"""Hosts whose clocks are a little behind take a new certificate at once."""


def create(folder: Path, days: int) -> Path:
    """Make a new authority and return its certificate's file, `ca.pem`.

    Raises:
        SettingsError: If there is one already: what it has signed would no longer be trusted.
    """
    certificate, key_file = folder / "ca.pem", folder / "ca.key"
    for path in (certificate, key_file):
        if path.exists():
            raise SettingsError(f"{path} is there already; choose another folder or remove it")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name("encircle authority")
    signed = (
        _builder(name, name, key.public_key(), days)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_others=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    _write_key(key_file, key)
    certificate.write_bytes(signed.public_bytes(serialization.Encoding.PEM))
    return certificate


def issue(folder: Path, role: str, file_name: str, hosts: Sequence[str], days: int) -> Path:
    """Sign a certificate for a role and return its file.

    Args:
        folder: of the authority; `<file_name>.pem` and `.key` are written there.
        role: the common name: what the holder is to everybody.
        file_name: without the ending.
        hosts: names and addresses at which it may be reached.
        days: it is valid for.

    Raises:
        SettingsError: If the folder holds no authority.
    """
    try:
        authority = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
        signer = serialization.load_pem_private_key((folder / "ca.key").read_bytes(), None)
    except (OSError, ValueError) as error:
        raise SettingsError(
            f"{folder} holds no authority ({error}); encircle certs init {folder}"
        ) from error
    if not isinstance(signer, ec.EllipticCurvePrivateKey):
        raise SettingsError(f"{folder / 'ca.key'} must be an elliptic curve key, as `init` makes")
    key = ec.generate_private_key(ec.SECP256R1())
    both = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    signed = (
        _builder(_name(role), authority.subject, key.public_key(), days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_others=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(both), critical=False)
        .add_extension(x509.SubjectAlternativeName([_host(host) for host in hosts]), critical=False)
        .sign(signer, hashes.SHA256())
    )
    _write_key(folder / f"{file_name}.key", key)
    path = folder / f"{file_name}.pem"
    path.write_bytes(signed.public_bytes(serialization.Encoding.PEM))
    return path


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    end = now + timedelta(days=days)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(min(now, end) - _CLOCK_SKEW)
        .not_valid_after(end)
    )


def _usage(*, signs_others: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_others,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_others,
        crl_sign=signs_others,
        encipher_only=False,
        decipher_only=False,
    )


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _write_key(path: Path, key: ec.EllipticCurvePrivateKey) -> None:
    """Write a private key that only its owner reads, from its first byte on."""
    pem = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(pem)
