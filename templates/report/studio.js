// What a server adds: actions are sent to it, what runs is followed, and the page follows the files.
import { start, isHeld } from "./move.js";
import { patch } from "./patch.js";
import { commandOf, element, levelOf, textOf } from "./show.js";
import { wanted } from "./lookup.js";

const followed = (page) => ["header.page", "main", "footer"].map((part) => page.querySelector(part));
let served = followed(document).map((part) => part.cloneNode(true)); // as the server sent them last
let page = start();
let version = null; // the last that the server sent
let refreshing = false;
let isRunning = false; // as the server sent last
let news = null; // the stream of the server's news
let asking = 0; // requests that wait for their answer

// A browser has six connections to a server, for all its tabs together, and a stream keeps one. So a hidden tab has no
// stream, and a request takes the place of its own tab's.
const listen = () => {
  if (news || asking > 0 || document.hidden) return;
  news = new EventSource("events");
  news.addEventListener("open", () => (element("connection").hidden = true));
  news.addEventListener("error", lose);
  news.addEventListener("work", (event) => showWork(JSON.parse(event.data)));
  news.addEventListener("files", (event) => {
    if (event.data !== element("main").dataset.version) follow(event.data);
  });
};

const unlisten = () => {
  news?.close();
  news = null;
};

const ask = async (address, options = {}) => {
  asking += 1;
  unlisten();
  try {
    return await fetch(address, options);
  } finally {
    asking -= 1;
    listen();
  }
};

const send = async (address, body) => {
  element("work-message").textContent = "";
  const response = await ask(address, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(body),
  });
  const isJson = (response.headers.get("Content-Type") ?? "").startsWith("application/json");
  const answer = isJson ? await response.json() : { message: await response.text() };
  if (!response.ok) throw new Error(answer.message);
  return answer;
};

const say = (message) => {
  element("work").hidden = false;
  element("work-message").textContent = message; // until something else is sent
};

// --- forms

const bodyOf = (form) => {
  const body = JSON.parse(form.dataset.body ?? "{}");
  for (const field of form.elements) {
    if (!field.name) continue;
    if (field.type === "checkbox") body[field.name] = field.checked;
    else if (field.type === "number") body[field.name] = field.value === "" ? null : Number(field.value);
    else if (field.name === "components") body[field.name] = field.value === "" ? [] : [field.value];
    else body[field.name] = field.value;
  }
  return body;
};

const wordsOf = (form, words) => {
  const component = form.elements.components?.value ?? "";
  const given = [...form.elements].filter((field) => field.dataset.flag && (field.type === "checkbox" ? field.checked : field.value !== ""));
  const options = given.flatMap((field) => (field.type === "checkbox" ? field.dataset.flag : field.dataset.flag.split(" ").map((flag) => `${flag} ${field.value}%`)));
  return [words, component, ...options].filter(Boolean).join(" ");
};

const showWords = (form) => {
  const code = form.querySelector("code[data-words]");
  if (code) code.textContent = `${wordsOf(form, code.dataset.words)}${code.dataset.end}`;
};

// What cannot be asked together: the field that was set last counts.
const settle = (field) => {
  if (field.type === "checkbox" ? !field.checked : field.value === "") return;
  for (const name of (field.dataset.excludes ?? "").split(" ").filter(Boolean)) {
    const other = field.form.elements[name];
    if (other.type === "checkbox") other.checked = false;
    else other.value = "";
  }
};

const begin = async (form) => {
  try {
    await send(`do/${form.dataset.action}`, bodyOf(form));
    element("work").scrollIntoView({ block: "nearest" });
  } catch (problem) {
    say(problem.message);
  }
};

// A component, or one setting of it.
const measureOf = (names, setting = null) => {
  const body = { components: names, together: names.length > 1, first: setting, last: setting };
  return send("do/measure", body).catch((problem) => say(problem.message));
};

// --- levels

const cardOf = (id) => page.cards.find((card) => card.id === id);
const previews = new WeakMap(); // by edit on the page: the levels that were shown, and the digest of the text before

const showPreview = async (edit, levels) => {
  const commands = levels.map((level) => commandOf(page, level)).join("\n");
  let shown = { difference: "", text: "" };
  let problem = levels.length === 0 ? "Move a line first." : "";
  try {
    if (levels.length > 0) shown = await send("levels", { levels });
  } catch (error) {
    problem = error.message;
  }
  previews.set(edit, { levels, digest: shown.digest });
  edit.querySelector(".difference").textContent = shown.difference || (problem ? "Nothing can be written." : "The manifest already has this value.");
  edit.querySelector(".follows").textContent = problem || `${commands}\n${shown.text}`;
  edit.querySelector(".write").hidden = shown.difference === "";
  edit.hidden = false;
};

// All levels, onto the text that was shown, or none.
const write = async (edit) => {
  try {
    await send("levels", previews.get(edit));
    edit.querySelector(".follows").textContent = "Written into the manifest.";
    edit.querySelector(".write").hidden = true;
    edit.tabIndex = -1;
    edit.focus({ preventScroll: true });
  } catch (problem) {
    edit.querySelector(".follows").textContent = problem.message;
  }
};

// --- what runs

const resize = (parent, count, name) => {
  while (parent.childElementCount > count) parent.lastElementChild.remove();
  while (parent.childElementCount < count) parent.append(document.createElement(name));
};

// Rows that stay are not made again: they may be read, selected and scrolled meanwhile.
const showRows = (rows) => {
  const body = element("work-rows");
  resize(body, rows.length, "tr");
  rows.forEach((cells, at) => {
    resize(body.children[at], cells.length, "td");
    cells.forEach((text, place) => textOf(body.children[at].children[place], text));
  });
};

const showWork = (work) => {
  if (work.number === 0) return;
  isRunning = work.ending === "";
  textOf(element("work-title"), isRunning ? "Running action" : "Last command");
  element("work").dataset.state = `${work.number}${work.ending}`; // what a page that has caught up begins its version with
  element("work").hidden = false;
  element("work-command").textContent = work.command;
  element("work-status").textContent = isRunning ? "runs." : { done: "ended.", stopped: "was stopped.", failed: "ended with problems.", shown: "shown; nothing was changed." }[work.ending];
  const stop = element("work-stop");
  stop.dataset.number = work.number;
  if (!isRunning && stop === document.activeElement) element("work").focus({ preventScroll: true });
  stop.hidden = !isRunning;
  const rows = work.current.length > 0 ? [...work.rows, work.current] : work.rows;
  showRows(rows);
  element("work-lines").hidden = work.lines.length === 0;
  textOf(element("work-lines"), work.lines.map((text) => text.trimEnd()).join("\n"));
};

// --- following the files

// Where what had the focus is gone, its section has it, or what runs.
const keepFocus = (focused, section) => {
  if ((focused === document.activeElement && !focused.disabled) || focused === document.body) return;
  const next = [focused, section, element("work"), element("main")].find((each) => each?.isConnected && !each.hidden && !each.disabled);
  if (next !== focused) next.tabIndex = -1;
  next.focus({ preventScroll: true });
};

const refresh = async () => {
  const response = await ask(".");
  if (!response.ok) throw new Error(String(response.status));
  const fresh = new DOMParser().parseFromString(await response.text(), "text/html");
  const latest = followed(fresh);
  const focused = document.activeElement;
  const section = focused.closest("section");
  followed(document).forEach((part, at) => patch(part, served[at], latest[at]));
  served = latest;
  document.title = fresh.title;
  page = start();
  document.querySelectorAll("form").forEach(showWords);
  keepFocus(focused, section);
};

// Until the server's news come again. One that answers is there: it does not know this browser, or is asked again.
const showLoss = async () => {
  let reason = isRunning ? "cut" : "gone";
  try {
    const answer = await fetch("style.css", { method: "HEAD", cache: "no-store" });
    if (answer.ok) return;
    reason = "refused";
  } catch {
    element("work-stop").hidden = true;
    if (isRunning) element("work-status").textContent = "was interrupted.";
  }
  for (const text of element("connection").children) text.hidden = text.dataset.when !== reason;
  element("connection").hidden = false;
};

const PAUSE = 2000; // in ms, before a stream is asked for again that the server refused

// A browser asks again by itself for a stream that broke off, but not for one that was refused.
const lose = (event) => {
  const lost = event.target;
  const again = () => {
    if (lost !== news) return;
    unlisten();
    listen();
  };
  if (lost.readyState === EventSource.CLOSED) setTimeout(again, PAUSE);
  return showLoss();
};

// While a line is held, the page stays as it is.
const follow = async (latest) => {
  version = latest;
  if (refreshing) return;
  refreshing = true;
  try {
    for (let shown = null; shown !== version; ) {
      if (isHeld()) {
        await new Promise((resolve) => setTimeout(resolve, 200));
        continue;
      }
      shown = version;
      await refresh();
    }
  } catch {
    await showLoss();
  } finally {
    refreshing = false;
  }
};

document.addEventListener("visibilitychange", () => (document.hidden ? unlisten() : listen()));
listen();

// --- clicks

document.addEventListener("submit", (event) => {
  const form = event.target;
  event.preventDefault();
  if (form.dataset.action) begin(form);
  if (form.dataset.for) measureOf(form.dataset.for.split(" "), Number(form.elements.setting.value));
});
document.addEventListener("input", (event) => {
  const form = event.target.closest("form");
  if (!form) return;
  settle(event.target);
  showWords(form);
});
document.addEventListener("line", (event) => {
  const edit = element(event.detail.id).querySelector("[data-edit] .edit");
  edit.hidden = true; // what was shown is not what would be written now
});
document.addEventListener("click", (event) => {
  const button = event.target.closest("button");
  if (!button) return;
  const { preview, levels, measure, way } = button.dataset;
  const edit = button.closest("[data-edit]")?.querySelector(".edit");
  if (button.id === "work-stop") send("stop", { number: Number(button.dataset.number) }).catch((problem) => say(problem.message));
  if (preview) showPreview(edit, wanted(cardOf(preview)).map(levelOf));
  if (levels) showPreview(edit, JSON.parse(levels));
  if (button.classList.contains("write")) write(edit);
  if (measure) measureOf([measure]);
  if (way) element(way).querySelector("button").focus();
});
