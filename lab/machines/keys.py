"""``formnet keys init``: an authority of one's own, and a certificate for everybody."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from formnet.formation.wire.security import MONITOR, PLANT, robot_name
from formnet.lab.runs import files

LOCAL = ("localhost", "127.0.0.1", "::1")
_AUTHORITY_KEY = "ca-key.pem"


class KeysExist(FileExistsError):
    """A file of keys is there already; none is ever overwritten."""


def robots_of(text: str) -> list[int]:
    """The ids in ``1-5,8``, ascending.

    Raises:
        ValueError: it is no such list.
    """
    found: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", part)
        if match is None:
            raise ValueError(f"{part!r} is neither a robot's id nor a range such as 1-5")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first or last - first > 100_000:
            raise ValueError(f"{part!r} is no range of robots' ids")
        found.update(range(first, last + 1))
    return sorted(found)


def make(folder: Path, robots: Sequence[int], hosts: Sequence[str], days: int) -> list[Path]:
    """Write an authority (unless there is one) and the certificates that are missing.

    ``hosts`` are the names and addresses at which the plant may be reached, beside
    this machine's own. Elliptic-curve keys (P-256), private ones with mode 0600. Returns what
    was written.

    Raises:
        KeysExist: everything is there already, or an authority without its private key.
        OSError: ``folder`` cannot be written.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    written: list[Path] = []
    authority, authority_key = _authority(folder, days, written)
    for name in (PLANT, MONITOR, *map(robot_name, robots)):
        certificate, private = folder / f"{name}.pem", folder / f"{name}-key.pem"
        if certificate.exists() and private.exists():
            continue
        key = ec.generate_private_key(ec.SECP256R1())
        names = [*LOCAL, *hosts] if name == PLANT else []
        signed = _certificate(name, names, key, authority.subject, authority_key, days)
        written += _write(private, key, certificate, signed)
    if not written:
        raise KeysExist(f"{folder} has all of these keys already; keys are never overwritten")
    return written


def _authority(
    folder: Path, days: int, written: list[Path]
) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    certificate, private = folder / "ca.pem", folder / _AUTHORITY_KEY
    if certificate.exists():
        if not private.exists():
            raise KeysExist(
                f"{certificate} is there and its {private.name} is not: certificates "
                "are made where the authority's key is"
            )
        key = serialization.load_pem_private_key(private.read_bytes(), None)
        assert isinstance(key, ec.EllipticCurvePrivateKey)
        return x509.load_pem_x509_certificate(certificate.read_bytes()), key
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "formnet authority")])
    made = (
        _builder(name, name, key, days)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    written += _write(private, key, certificate, made)
    return made, key


def _certificate(
    name: str,
    hosts: Sequence[str],
    key: ec.EllipticCurvePrivateKey,
    issuer: x509.Name,
    issuer_key: ec.EllipticCurvePrivateKey,
    days: int,
) -> x509.Certificate:
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    if hosts:
        uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
    builder = (
        _builder(subject, issuer, key, days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()),
            critical=False,
        )
        .add_extension(
            x509.SubjectAlternativeName(list(map(_host, hosts or [f"{name}.formnet.invalid"]))),
            critical=False,
        )
    )
    return builder.sign(issuer_key, hashes.SHA256())


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))  # clocks differ
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _write(
    private: Path, key: ec.EllipticCurvePrivateKey, certificate: Path, signed: x509.Certificate
) -> list[Path]:
    """Two new files, or none; the secret is never readable by others, not even for a moment."""
    secret = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    try:
        files.write_new(private, secret, 0o600)
        try:
            files.write_new(certificate, signed.public_bytes(serialization.Encoding.PEM), 0o644)
        except OSError:
            private.unlink()  # without its certificate it would be in the way
            raise
    except FileExistsError as error:
        raise KeysExist(f"{error.filename} is there already; it is never overwritten") from None
    return [private, certificate]
