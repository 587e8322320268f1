"""What a certificate says, wherever its file lies: who signed it, and until when it counts."""

import hashlib
from datetime import datetime
from typing import Any, NamedTuple

from cryptography import x509

_RENEWAL = "where ca-key.pem is, make another (`formnet keys renew DIR NAME`), and copy it there"


class BadCertificate(ValueError):
    """It is none, or its authority has not signed it; the text says why, ``remedy`` what to do."""

    def __init__(self, text: str, remedy: str = _RENEWAL) -> None:
        self.remedy = remedy
        super().__init__(text)


class Seen(NamedTuple):
    """``authority_sha256`` is that of the authority's file; both times know their zone."""

    common_name: str
    authority_sha256: str
    expires: datetime
    authority_expires: datetime


def examine(found: dict[str, Any]) -> Seen:
    """Read what :func:`lab.machines.probe.certificate` found: two texts in PEM, or a problem.

    Raises:
        BadCertificate: it found a problem, or what it found is not one signed by the other.
    """
    if "problem" in found:
        raise BadCertificate(str(found["problem"]), str(found.get("remedy", _RENEWAL)))
    own_pem, authority_pem = str(found.get("certificate")), str(found.get("authority"))
    try:
        own = x509.load_pem_x509_certificate(own_pem.encode())
        authority = x509.load_pem_x509_certificate(authority_pem.encode())
        own.verify_directly_issued_by(authority)
        common_name = str(own.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)[0].value)
    except Exception as error:  # a broken file, a signature of another: many kinds
        reason = str(error) or type(error).__name__
        raise BadCertificate(f"{found.get('file')} is not of this ca.pem: {reason}") from None
    sha256 = hashlib.sha256(authority_pem.encode()).hexdigest()
    return Seen(common_name, sha256, own.not_valid_after_utc, authority.not_valid_after_utc)
