"""A certificate authority: made, read from its folder, and the certificates that it signs."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from formnet.formation.machines.custody import (
    AUTHORITY,
    AUTHORITY_KEY,
    KeysError,
    check_file,
)
from formnet.formation.machines.matching import check_pair

AUTHORITY_DAYS = 3650
"""An authority signs anew what ends, so it lasts longer."""
LOCAL = ("localhost", "127.0.0.1", "::1")
_ELSEWHERE = "make a new authority in another folder (`formnet keys init`)"


class Pair(NamedTuple):
    """A private key and its certificate, each as its file holds it."""

    private_key: bytes
    certificate: bytes


class Authority(NamedTuple):
    """What signs: its own certificate, and its private key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @classmethod
    def made(cls) -> "Authority":
        """A new one, with an elliptic-curve key (P-256)."""
        key = ec.generate_private_key(ec.SECP256R1())
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "formnet authority")])
        ends = datetime.now(UTC) + timedelta(days=AUTHORITY_DAYS)
        signed = (
            _builder(name, name, key, ends)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs_certificates=True), critical=True)
            .sign(key, hashes.SHA256())
        )
        return cls(signed, key)

    @classmethod
    def read(cls, folder: Path) -> "Authority":
        """That of a folder, which :func:`check_folder` has seen.

        Raises:
            KeysError: it is not whole, others may read or change it, it is none or has expired.
        """
        certificate, private_key = folder / AUTHORITY, folder / AUTHORITY_KEY
        check_file(
            certificate,
            secret=False,
            make=f"copy it back from any host (it is public); if {AUTHORITY_KEY} has never signed "
            f"anything, delete {AUTHORITY_KEY}",
        )
        check_file(
            private_key,
            secret=True,
            make="certificates are made where the authority's key is; if it is lost, " + _ELSEWHERE,
        )
        check_pair(certificate, private_key, "copy both again from where they were made")
        key = serialization.load_pem_private_key(private_key.read_bytes(), None)
        own = x509.load_pem_x509_certificate(certificate.read_bytes())
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise KeysError(f"{private_key} is no elliptic-curve key", _ELSEWHERE)
        if own.not_valid_after_utc <= datetime.now(UTC):
            raise KeysError(f"{certificate} has expired", _ELSEWHERE)
        return cls(own, key)

    @property
    def pair(self) -> Pair:
        """As its files hold it."""
        return Pair(_secret(self.key), self.certificate.public_bytes(serialization.Encoding.PEM))

    def issue(self, name: str, common_name: str, hosts: Sequence[str], days: int) -> Pair:
        """A new key and its certificate, of ``days`` days but not longer than the authority's.

        ``hosts`` are the names and addresses at which a server may be reached, empty for a client.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if hosts:
            uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        ends = datetime.now(UTC) + timedelta(days=days)
        signed = (
            _builder(
                subject,
                self.certificate.subject,
                key,
                min(ends, self.certificate.not_valid_after_utc),
            )
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_certificates=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self.key.public_key()),
                critical=False,
            )
            .add_extension(
                x509.SubjectAlternativeName(list(map(_host, hosts or [f"{name}.formnet.invalid"]))),
                critical=False,
            )
            .sign(self.key, hashes.SHA256())
        )
        return Pair(_secret(key), signed.public_bytes(serialization.Encoding.PEM))


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, ends: datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(datetime.now(UTC) - timedelta(days=1))  # clocks differ
        .not_valid_after(ends)
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


def _secret(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
