"use strict";
const EVERY_MS = 1000;
const ARROWS = { forward: "→", backward: "←" };
const at = (id) => document.getElementById(id);
const token = () => new URLSearchParams(location.hash.slice(1)).get("token") ?? "";

// What is shown comes from strangers: characters that act or hide are escaped as elsewhere.
const printable = (text) => String(text).replace(/[\p{Cc}\p{Cf}\p{Cs}\p{Zl}\p{Zp}]/gu, (letter) => {
  const point = letter.codePointAt(0).toString(16);
  return point.length < 3 ? "\\x" + point.padStart(2, "0")
    : point.length < 5 ? "\\u" + point.padStart(4, "0") : "\\U" + point.padStart(8, "0");
});

async function call(path, body) {
  const options = { headers: { Authorization: "Bearer " + token() } };
  if (body !== undefined) {
    options.method = "POST";
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  const found = await fetch(path, options);
  const content = await found.json();
  if (!found.ok) throw Object.assign(new Error(content.problems.join("; ")), { status: found.status });
  return content;
}

function made(kind, text, ...classes) {
  const element = document.createElement(kind);
  element.textContent = text === undefined ? "" : printable(text);
  element.classList.add(...classes);
  return element;
}

const digits = (value) => Number(value.toPrecision(3)).toString();
const ms = (seconds) => (seconds === undefined ? "–" : digits(seconds * 1e3));
const lost = (link) => Object.entries(link.lost)
  .map(([cause, count]) => `${cause} ${(100 * count / link.sent).toFixed(2)}%`).join(", ") || "–";
const name = (link) => `${ARROWS[link.direction]} ${link.link}`;
const named = (link) => ({ link: link.link, direction: link.direction });

function row(link, isCut) {
  const line = made("tr");
  const head = made("th", name(link));
  head.scope = "row";
  const delay = link.delay_s ?? {};
  const turn = made("button", isCut ? "heal" : "cut");
  turn.type = "button";
  turn.ariaLabel = `${isCut ? "heal" : "cut"} ${printable(name(link))}`;
  turn.addEventListener("click", () => act(isCut ? "/heal" : "/cut", named(link)));
  const last = made("td");
  last.append(turn);
  const state = made("td");
  state.append(made("span", isCut ? "cut" : "open", "mark", isCut ? "bad" : "good"));
  line.append(head, made("td", link.sent, "n"), made("td", link.delivered, "n"),
    made("td", lost(link), "lost"), made("td", link.in_flight, "n"),
    ...["mean", "p99", "max"].map((key) => made("td", ms(delay[key]), "n")),
    made("td", digits(link.longest_silence_s), "n"), state, last);
  return line;
}

function setting(link) {
  const { link: _, direction: __, cut: ___, ...rest } = link;
  const block = made("pre");
  block.textContent = printable(name(link)) + "\n" + Object.entries(rest)
    .map(([key, value]) => `${printable(key)} = ${printable(JSON.stringify(value))}`).join("\n");
  return block;
}

// Rows are replaced only if something in them has changed: a button that has the focus keeps it.
const shown = new Map();
function put(place, items, make) {
  const text = JSON.stringify(items);
  if (shown.get(place) === text) return;
  const focus = [...place.querySelectorAll("button")].indexOf(document.activeElement);
  shown.set(place, text);
  place.replaceChildren(...items.map(make));
  if (focus >= 0) place.querySelectorAll("button")[focus]?.focus();
}

function say(state, tone) {
  at("state").textContent = state;
  at("state").className = "mark " + tone;
  at("head").className = "card verdict " + tone;
}

async function show() {
  try {
    const [statistics, settings] = await Promise.all([call("/statistics"), call("/network")]);
    put(at("links"), statistics.map((link, k) => [link, settings[k].cut]), ([link, cut]) => row(link, cut));
    put(at("settings"), settings, setting);
    const choices = [{ all: true }, ...settings.map(named)];
    put(at("which"), choices, (choice) => {
      const option = made("option", choice.all ? "all" : name(choice));
      option.value = JSON.stringify(choice.all ? {} : choice);
      return option;
    });
    at("ask").hidden = true;
    say("connected", "good");
  } catch (error) {
    at("ask").hidden = error.status !== 401;
    say(error.status === 401 ? "token missing or wrong" : error.status ? "refused" : "not reachable", "bad");
  }
}

async function act(path, body) {
  try {
    const { done } = await call(path, body);
    tell(`${path.slice(1)}: ${done.map(name).join(", ")}`, "good");
  } catch (error) {
    tell(error.message, "bad");
  }
  await show();
}

function tell(text, tone) {
  at("answer").textContent = printable(text);
  at("answer").className = tone;
}

at("cut").addEventListener("click", () => act("/cut", {}));
at("heal").addEventListener("click", () => act("/heal", {}));
at("change").addEventListener("submit", (event) => {
  event.preventDefault();
  let what;
  try {
    what = JSON.parse(at("what").value);
  } catch (error) {
    tell(error.message, "bad");
    return;
  }
  act("/network", { ...what, ...JSON.parse(at("which").value) });
});
at("ask").addEventListener("submit", (event) => {
  event.preventDefault();
  location.hash = "token=" + encodeURIComponent(at("token").value.trim());
  at("token").value = "";
  show();
});

(async () => {
  for (;;) {
    await show();
    await new Promise((resolve) => setTimeout(resolve, EVERY_MS));
  }
})();
