"""Whether a certificate, its private key and an authority belong together, as TLS sees it.

The standard library verifies certificates in handshakes alone, so there is one, in memory, in which
the certificate is a client's. No host needs a package for it.
"""

import ssl
from pathlib import Path
from typing import Any

from formnet.formation.machines.custody import KeysError

_EXPIRED, _NOT_YET = 10, 9
"""X509_V_ERR_CERT_HAS_EXPIRED and X509_V_ERR_CERT_NOT_YET_VALID of OpenSSL."""
_FLIGHTS = 8


def check_pair(certificate: Path, private_key: Path, remedy: str) -> None:
    """See that the key is the certificate's.

    Raises:
        KeysError: it is not, or one of the two files is something else.
    """
    _loaded(ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT), certificate, private_key, remedy)


def common_name_of(authority: Path, certificate: Path, private_key: Path, remedy: str) -> str:
    """The common name in a certificate that ``authority`` has signed, and that counts now.

    Raises:
        KeysError: it is not so, or the key is another's; ``remedy`` is what mends it.
    """
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    for context in (server, client):
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        _loaded(context, certificate, private_key, remedy)
    server.verify_mode = ssl.CERT_REQUIRED
    try:
        server.load_verify_locations(authority)
    except (OSError, ssl.SSLError):
        raise KeysError(f"{authority} is no certificate", "copy it again") from None
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = (client.wrap_bio(to_client, to_server), server.wrap_bio(to_server, to_client, True))
    try:
        for _ in range(_FLIGHTS):
            for end in ends:
                try:
                    end.do_handshake()
                except ssl.SSLWantReadError:
                    continue
        found: dict[str, Any] = ends[1].getpeercert() or {}
    except (ssl.SSLError, ValueError) as error:
        why = {_EXPIRED: "has expired, or ca.pem has", _NOT_YET: "is not valid yet"}.get(
            getattr(error, "verify_code", 0), f"is not of this {authority.name}"
        )
        raise KeysError(f"{certificate} {why}", remedy) from None
    parts = [part for group in found.get("subject", ()) for part in group]
    names = [str(value) for key, value in parts if key == "commonName"]
    return names[0] if len(names) == 1 else ""


def _loaded(context: ssl.SSLContext, certificate: Path, private_key: Path, remedy: str) -> None:
    try:
        context.load_cert_chain(certificate, private_key, password=lambda: b"")  # never ask for one
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            problem = f"{private_key} is not the private key of {certificate.name}"
        else:
            problem = f"{certificate} and {private_key.name} are no certificate with its key"
        raise KeysError(problem, remedy) from None
    except OSError as error:
        raise KeysError(f"{certificate}: {error.strerror}", remedy) from None
