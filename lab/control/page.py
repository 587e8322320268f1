"""The control endpoint's own page: the links, what becomes of their messages, what changes them.

It is the same for everyone and holds nothing of the bridge. Its script takes the token from the
fragment of the address, which browsers send nowhere, and gives it as curl does.
"""

from functools import cache
from typing import NamedTuple

from formnet.lab.pages.template import environment

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""Of every answer; the page has a policy of its own beside it."""


class Page(NamedTuple):
    """HTML, and its Content-Security-Policy."""

    text: str
    policy: str


@cache
def page() -> Page:
    """The page; its policy is that in its head, and that it stands in no frame."""
    made = environment().get_template("control.html.j2").make_module()
    return Page(str(made), f"{made.__dict__['allowed']}; frame-ancestors 'none'")
