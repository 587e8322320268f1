"""Which requests the control endpoint lets in, by their heads alone."""

import pytest

from formnet.lab.control.gate import Gate, new_token

TOKEN = "a-token-of-43-letters-as-they-all-have_it-0"
GATE = Gate("127.0.0.1", TOKEN)
RIGHT = {
    "Host": "127.0.0.1:8765",
    "Authorization": f"Bearer {TOKEN}",
    "Content-Type": "application/json",
}


def status(gate=GATE, method="POST", *, public=False, **changes):
    """200 for what is let in; a header that is None is left out."""
    headers = RIGHT | {name.replace("_", "-"): value for name, value in changes.items()}
    present = {name: value for name, value in headers.items() if value is not None}
    refused = gate.refused(method, present, public=public)
    return 200 if refused is None else refused.status


@pytest.mark.parametrize(
    "host",
    ["127.0.0.1", "127.0.0.1:8765", "localhost:8765", "LOCALHOST", "[::1]:8765", "localhost:9000"],
)
def test_this_endpoint_is_found_by_its_names_and_through_a_tunnel(host):
    assert status(Host=host) == 200
    assert status(Host=host, Origin=f"http://{host}") == 200


@pytest.mark.parametrize(
    "host",
    [
        None,
        "",
        "rebound.test:8765",
        "127.0.0.1.rebound.test",
        "localhost.rebound.test",
        "192.0.2.1:8765",
        "[2001:db8::1]:8765",
        "user@localhost",
        "localhost@rebound.test",
        "localhost/",
        "localhost:x",
        "localhost, rebound.test",
        "[::1",
        "0",
    ],
)
def test_another_host_is_refused_before_anything_else(host):
    assert status(Host=host) == 403
    assert status(Host=host, method="GET", public=True) == 403


@pytest.mark.parametrize(
    "origin",
    [
        "null",
        "http://rebound.test:8765",
        "http://127.0.0.1:8000",
        "http://127.0.0.1",
        "http://localhost:8765",
        "https://127.0.0.1:8765",
        "file://",
        "",
    ],
)
def test_a_page_of_another_origin_is_refused(origin):
    assert status(Origin=origin) == 403
    assert status(Origin=origin, method="GET", public=True) == 403


@pytest.mark.parametrize(
    "given",
    [
        None,
        "",
        TOKEN,
        "Bearer",
        "Bearer ",
        f"Basic {TOKEN}",
        f"Bearer {TOKEN[:-1]}",
        f"Bearer {TOKEN}x",
        "Bearer ü",
        f"Bearer {TOKEN[::-1]}",
    ],
)
def test_reading_and_changing_need_the_token(given):
    assert status(Authorization=given) == 401
    assert status(Authorization=given, method="GET") == 401
    assert status(Authorization=given, method="GET", public=True) == 200


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("application/json; charset=utf-8", 200),
        ("Application/JSON", 200),
        (None, 415),
        ("text/plain", 415),
        ("application/x-www-form-urlencoded", 415),
        ("multipart/form-data; boundary=x", 415),
        ("text/plain; application/json", 415),
    ],
)
def test_a_change_is_json(kind, expected):
    assert status(Content_Type=kind) == expected
    assert status(Content_Type=kind, method="GET") == 200


def test_off_loopback_an_address_will_do_and_of_names_the_one_that_was_given():
    gate = Gate("lab-7.example", TOKEN, anywhere=True)
    assert status(gate, Host="192.0.2.1:8765") == 200
    assert status(gate, Host="lab-7.example:8765") == 200
    assert status(gate, Host="rebound.test:8765") == 403
    assert status(gate, Host="192.0.2.1:8765", Origin="http://192.0.2.2:8765") == 403


def test_no_two_tokens_are_alike_and_each_has_256_bits():
    found = {new_token() for _ in range(100)}
    assert len(found) == 100
    assert {len(token) for token in found} == {43} == {len(TOKEN)}  # 43 letters of 6 bits
