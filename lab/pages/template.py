"""Templates of pages: how a stranger's text gets into them, and what a page may load and run.

Text is escaped for HTML (Jinja's autoescape), and what would act or hide in it is escaped before
(:mod:`formnet.netem.files.printable`). Should anything get through all the same, the page's policy
(Content Security Policy Level 3) lets no script run and no style apply but the page's own, known by
their hashes, and nothing be loaded from elsewhere.
"""

import base64
from hashlib import sha256
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from formnet.netem.files.printable import printable


def environment() -> Environment:
    """Where the templates of this room are."""
    made = Environment(
        loader=PackageLoader("formnet.lab.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_shown,
    )
    made.globals["policy"] = policy
    return made


def policy(style: str, script: str = "", **directives: str) -> str:
    """The Content-Security-Policy of a page with this style and script; ``img="data:"`` is img-src.

    ``style`` and ``script`` are all that stands between their tags.
    """
    sources = {"style-src": _hash(style), "script-src": _hash(script) if script else "'none'"}
    sources |= {f"{name}-src": source for name, source in directives.items()}
    return "; ".join(
        f"{name} {source}"
        for name, source in {
            "default-src": "'none'",
            **sources,
            "base-uri": "'none'",
            "form-action": "'none'",
        }.items()
    )


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(sha256(text.encode()).digest()).decode('ascii')}'"


def _shown(value: Any) -> Any:
    """A value as it gets into a page; what is markup already has been through here."""
    if isinstance(value, str) and not isinstance(value, Markup):
        return printable(value, lines=True)
    return value
