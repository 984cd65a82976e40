// What a server adds: actions are sent to it, what runs is followed, and the page follows the files.
import { start, isHeld } from "./move.js";
import { element } from "./show.js";
import { wanted } from "./lookup.js";

let page = start();
let version = null; // the last that the server told of
let refreshing = false;

const send = async (address, body) => {
  const response = await fetch(address, {
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
  element("work-status").textContent = message;
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
  const setting = form.elements.setting?.value ?? "";
  const flags = [...form.elements].filter((field) => field.type === "checkbox" && field.checked).map((field) => field.dataset.flag);
  return [words, component, ...(setting === "" ? [] : [`--from ${setting}% --to ${setting}%`]), ...flags].filter(Boolean).join(" ");
};

const showWords = (form) => {
  const code = form.querySelector("code[data-words]");
  if (code) code.textContent = `${wordsOf(form, code.dataset.words)}${code.dataset.end}`;
};

const begin = async (form) => {
  try {
    await send(`do/${form.dataset.action}`, bodyOf(form));
    element("work").scrollIntoView({ block: "nearest" });
  } catch (problem) {
    say(problem.message);
  }
};

const measureAlone = (name, setting = "") => {
  const form = element("measure");
  form.elements.components.value = name;
  form.elements.setting.value = setting;
  showWords(form);
  form.requestSubmit();
};

// --- levels

const cardOf = (id) => page.cards.find((card) => card.id === id);
const previews = new Map(); // by card: what was shown, in the order in which it is written
const levelOf = (plot, digest) => ({ component: plot.component, index: plot.index, level: `${plot.text} ${plot.unit}`, digest });

const showPreview = async (card) => {
  const answers = [];
  const problems = [];
  for (const plot of wanted(card)) {
    try {
      answers.push({ plot, ...(await send("level", levelOf(plot, ""))) });
    } catch (problem) {
      problems.push(problem.message);
    }
  }
  previews.set(card.id, problems.length > 0 ? [] : answers);
  const differences = answers.map((answer) => answer.difference).join("");
  element(`${card.id}-difference`).textContent = differences || (problems.length > 0 ? "Nothing can be written." : "The manifest says so already.");
  element(`${card.id}-follows`).textContent = [...problems, ...answers.map((answer) => answer.text)].join("\n");
  element(`${card.id}-edit`).hidden = false;
  const button = document.querySelector(`[data-write="${card.id}"]`);
  button.hidden = problems.length > 0 || differences === "";
};

// Each level is written onto the text that was shown, or that the level before it left.
const write = async (card) => {
  const answers = previews.get(card.id) ?? [];
  let digest = answers[0]?.digest;
  try {
    for (const { plot, difference } of answers) {
      if (difference === "") continue;
      digest = (await send("level", levelOf(plot, digest))).after;
      plot.moved = false;
    }
    element(`${card.id}-edit`).hidden = true;
  } catch (problem) {
    element(`${card.id}-follows`).textContent = problem.message;
  }
};

// --- what runs

const showWork = (work) => {
  if (work.number === 0) return;
  const isRunning = work.ending === "";
  element("work").hidden = false;
  element("work-command").textContent = work.command;
  element("work-status").textContent = isRunning ? "runs." : { done: "ended.", stopped: "was stopped.", failed: "ended with problems." }[work.ending];
  element("work-stop").hidden = !isRunning;
  const rows = work.current.length > 0 ? [...work.rows, work.current] : work.rows;
  element("work-rows").replaceChildren(
    ...rows.map((cells) => {
      const row = document.createElement("tr");
      row.replaceChildren(...cells.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
      return row;
    }),
  );
  element("work-lines").hidden = work.lines.length === 0;
  element("work-lines").textContent = work.lines.map((text) => text.trimEnd()).join("\n");
  for (const form of document.querySelectorAll("form[data-action] button:not([data-off])")) form.classList.toggle("waiting", isRunning);
};

// --- following the files

const kept = (root) => ({
  open: [...root.querySelectorAll("details")].map((each) => each.open),
  fields: [...root.querySelectorAll("input, select")].filter((each) => each.id).map((each) => [each.id, each.type === "checkbox" ? each.checked : each.value]),
  focus: document.activeElement?.id,
});

const restore = (root, state) => {
  const details = [...root.querySelectorAll("details")];
  if (details.length === state.open.length) details.forEach((each, at) => (each.open = state.open[at]));
  for (const [id, value] of state.fields) {
    const field = element(id);
    if (field) field[field.type === "checkbox" ? "checked" : "value"] = value;
  }
  root.querySelectorAll("form[data-action]").forEach(showWords);
  if (state.focus) element(state.focus)?.focus({ preventScroll: true });
};

const refresh = async () => {
  const response = await fetch(".");
  if (!response.ok) throw new Error(String(response.status));
  const fresh = new DOMParser().parseFromString(await response.text(), "text/html");
  const state = kept(element("main"));
  element("main").replaceWith(fresh.getElementById("main"));
  document.title = fresh.title;
  document.querySelector("header.page").replaceWith(fresh.querySelector("header.page"));
  page = start();
  restore(element("main"), state);
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
  } finally {
    refreshing = false;
  }
};

const events = new EventSource("events");
events.addEventListener("open", () => (element("connection").hidden = true));
events.addEventListener("error", () => (element("connection").hidden = false));
events.addEventListener("work", (event) => showWork(JSON.parse(event.data)));
events.addEventListener("files", (event) => {
  if (event.data !== element("main").dataset.version) follow(event.data);
});

// --- clicks

document.addEventListener("submit", (event) => {
  event.preventDefault();
  if (event.target.dataset.action) begin(event.target);
});
document.addEventListener("input", (event) => {
  const form = event.target.closest("form[data-action]");
  if (form) showWords(form);
});
document.addEventListener("line", (event) => {
  const edit = element(`${event.detail.id}-edit`);
  if (edit) edit.hidden = true; // what was shown is not what would be written now
});
document.addEventListener("click", (event) => {
  const { preview, write: written, measure, way } = event.target.closest("button")?.dataset ?? {};
  if (event.target.id === "work-stop") send("stop", {});
  if (preview) showPreview(cardOf(preview));
  if (written) write(cardOf(written));
  if (measure) measureAlone(measure);
  if (way) element(way)?.scrollIntoView({ block: "center" });
});
