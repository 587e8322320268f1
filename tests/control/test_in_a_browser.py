"""The control endpoint in Chromium: attacked by pages of others, and used by its own."""

import json
import shutil
import subprocess
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from processes import missing, until

from formnet.lab.control.gate import Gate

ATTACK = """
async (target) => {
  const tried = {};  // what was read, by what was tried
  const put = async (name, path, options) => {
    try {
      const found = await fetch(target + path, options);
      tried[name] = found.type === "opaque" ? "" : `${found.status}: ${await found.text()}`;
    } catch (error) { tried[name] = ""; }
  };
  const body = "{}";
  await put("no-cors, a text", "/cut", { method: "POST", mode: "no-cors", body });
  await put("no-cors, named as JSON", "/cut",
    { method: "POST", mode: "no-cors", body, headers: { "Content-Type": "application/json" } });
  await put("no-cors, a form", "/cut", { method: "POST", mode: "no-cors", body: new URLSearchParams({ a: "b" }) });
  await put("cors, JSON", "/cut", { method: "POST", body, headers: { "Content-Type": "application/json" } });
  await put("cors, a token", "/cut", { method: "POST", body,
    headers: { "Content-Type": "application/json", "Authorization": "Bearer guess" } });
  await put("reads", "/network", {});
  await put("reads the page", "/", {});
  const blob = new Blob([body], { type: "text/plain" });
  navigator.sendBeacon(target + "/cut", blob);
  for (const enctype of ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data"]) {
    const frame = Object.assign(document.createElement("iframe"), { name: enctype });
    document.body.append(frame);
    const form = Object.assign(document.createElement("form"),
      { method: "POST", action: target + "/cut", target: enctype, enctype });
    form.append(Object.assign(document.createElement("input"), { name: '{"x":"', value: '"}' }));
    document.body.append(form);
    const loaded = new Promise((resolve) => frame.addEventListener("load", resolve));
    form.submit();
    await loaded;
  }
  const nested = document.createElement("iframe");  // its Origin is null
  nested.sandbox = "allow-scripts";
  nested.srcdoc = `<script>fetch("${target}/cut", { method: "POST", mode: "no-cors", body: "{}" })
    .finally(() => parent.postMessage("done", "*"))<\\/script>`;
  const told = new Promise((resolve) => addEventListener("message", resolve, { once: true }));
  document.body.append(nested);
  await told;
  return tried;
}
"""
ARRIVES = 8
"""How many of these requests a browser sends on from any page: what no permission is asked for."""
STEAL = """
async (token) => {
  const headers = { "Content-Type": "application/json" };
  if (token) headers.Authorization = "Bearer " + token;
  const found = await fetch("/cut", { method: "POST", body: "{}", headers });
  return [found.status, await found.text()];
}
"""


@contextmanager
def site():
    """A page of somebody else's on another port; its address."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>Kittens</title><body>")

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()


@pytest.fixture
def page(browser):
    """A page that remembers what its console says and whom it asks for what."""
    made = browser.new_page(viewport={"width": 1280, "height": 900})
    made.said, made.asked = [], []
    made.on("console", lambda message: made.said.append(message.text))
    made.on("pageerror", lambda error: made.said.append(str(error)))
    made.on("request", lambda request: made.asked.append(request))
    yield made
    made.close()


@pytest.fixture
def judged(monkeypatch):
    """The method, the path and the status of all that arrives at the gate."""
    found, refused = [], Gate.refused

    def remembered(gate, method, headers, **options):
        answer = refused(gate, method, headers, **options)
        found.append((method, 200 if answer is None else answer.status))
        return answer

    monkeypatch.setattr(Gate, "refused", remembered)
    return found


@pytest.mark.browser
def test_a_page_of_somebody_else_s_changes_nothing_and_reads_nothing(page, control, judged):
    with site() as address:
        page.goto(address)
        tried = page.evaluate(ATTACK, f"http://127.0.0.1:{control.port}")
        until(
            lambda: judged.count(("POST", 403)) == ARRIVES, "what a browser sends", judged.__str__
        )
    assert set(tried.values()) == {""}
    assert {status for _, status in judged} <= {403, 405}
    assert control.links.cut == []


@pytest.mark.browser
@pytest.mark.parametrize("knows", [False, True])
def test_a_name_that_is_made_to_lead_here_changes_nothing(page, control_at, judged, knows):
    """DNS rebinding: the attacker's page comes first, and then its name and port are those of the
    endpoint. Even with the token it would be refused."""
    with site() as address:
        port = int(address.strip("/").rpartition(":")[2])
        page.goto(f"http://rebound.test:{port}/")
    with control_at(port) as control:
        status, text = page.evaluate(STEAL, control.token if knows else "")
        assert (status, "Host" in text) == (403, True)
        assert judged == [("POST", 403)]
        assert control.links.cut == []


def row(page, name):
    return page.locator("tbody#links tr").filter(has=page.get_by_role("rowheader", name=name))


@pytest.mark.browser
def test_its_own_page_shows_and_changes_the_links(page, control):
    page.goto(control.url)
    page.get_by_text("connected", exact=True).wait_for()
    assert page.locator("tbody#links tr").count() == 6
    row(page, "→ robot/**").get_by_role("button").click()
    row(page, "→ robot/**").get_by_text("heal").wait_for()
    assert control.links.cut == ["robot/**"]
    page.get_by_role("button", name="Cut all").click()
    page.get_by_text("cut: → default").wait_for()
    assert len(control.links.cut) == 6
    page.get_by_role("button", name="Heal all").click()
    page.get_by_text("heal: → default").wait_for()
    assert control.links.cut == []
    page.get_by_role("combobox").select_option("→ robot/**")
    page.get_by_label("what changes").fill('{"loss": {"probability": 0.5}}')
    page.get_by_role("button", name="Change").click()
    page.get_by_text("network: → robot/**").wait_for()
    losses = {
        (one["link"], one["direction"]): one["loss"]["probability"]
        for one in control.links.settings()
    }
    assert losses.pop(("robot/**", "forward")) == 0.5
    assert set(losses.values()) == {0.0}
    page.get_by_label("what changes").fill('{"deley": 1}')
    page.get_by_role("button", name="Change").click()
    page.get_by_text("did you mean 'delay'").wait_for()
    page.get_by_label("what changes").fill("{")
    page.get_by_role("button", name="Change").click()
    page.locator("#answer.bad", has_text="JSON").wait_for()
    assert not [text for text in page.said if "Content Security Policy" in text]


@pytest.mark.browser
def test_the_token_goes_nowhere_but_into_its_header(page, control):
    page.goto(control.url)
    page.get_by_text("connected", exact=True).wait_for()
    asked = [request for request in page.asked if request.is_navigation_request() is False]
    assert asked
    assert {request.headers["authorization"] for request in asked} == {f"Bearer {control.token}"}
    for request in page.asked:
        assert control.token not in request.url.partition("#")[0]
        others = {k: v for k, v in request.headers.items() if k != "authorization"}
        assert control.token not in json.dumps(others)
    assert page.evaluate("[localStorage.length, sessionStorage.length, document.cookie]") == [
        0,
        0,
        "",
    ]


@pytest.mark.browser
def test_without_its_token_the_page_shows_nothing_and_asks_for_it(page, control):
    page.goto(control.url.partition("#")[0])
    page.get_by_text("token missing or wrong").wait_for()
    assert page.locator("tbody#links tr").count() == 0
    page.get_by_label("Token").fill(control.token)
    page.get_by_role("button", name="Use it").click()
    page.get_by_text("connected", exact=True).wait_for()
    assert page.locator("tbody#links tr").count() == 6


@pytest.mark.browser
def test_the_name_of_a_link_is_text_on_the_page(page, control):
    page.goto(control.url)
    page.get_by_text("connected", exact=True).wait_for()
    shown = page.locator("body").inner_text()
    assert r"a/\u202e\x1b]0;x\x07<img src=x onerror=alert(1)>" in shown
    assert not {"\u202e", "\x1b", "\x07"} & set(shown)
    assert page.locator("img").count() == 0
    assert not [text for text in page.said if "Content Security Policy" in text]


@pytest.mark.browser
def test_a_script_that_got_into_the_page_would_not_run(page, control):
    page.goto(control.url)
    page.evaluate(
        "() => { const s = document.createElement('script'); s.textContent = 'window.got = 1';"
        " document.body.append(s); document.body.insertAdjacentHTML('beforeend',"
        " '<img src=http://127.0.0.1:9/x onerror=window.got=1>'); }"
    )
    page.wait_for_function("() => document.images.length === 1")
    assert page.evaluate("window.got") is None
    assert sum("Content Security Policy" in text for text in page.said) >= 2


@pytest.mark.processes
def test_curl_with_the_token_works_and_without_it_does_not(control):
    """As docs/bridge.md has it."""
    if shutil.which("curl") is None:
        missing("curl")
    url = f"http://127.0.0.1:{control.port}"
    token = f"Authorization: Bearer {control.token_file.read_text().strip()}"
    cut = ["curl", "--silent", "--json", '{"link": "default"}', f"{url}/cut"]
    told = json.loads(subprocess.check_output(cut))
    assert "the token is missing" in told["problems"][0]
    assert control.links.cut == []
    told = json.loads(subprocess.check_output([*cut, "--header", token]))
    assert len(told["done"]) == 2
    assert control.links.cut == ["default", "default"]
    shown = subprocess.check_output(["curl", "--silent", "--header", token, f"{url}/network"])
    assert json.loads(shown) == json.loads(json.dumps(control.links.settings()))
