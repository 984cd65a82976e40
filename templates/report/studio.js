// What a server adds: actions are sent to it, what runs is followed, and the page follows the files.
import { start, isHeld } from "./move.js";
import { element } from "./show.js";
import { wanted } from "./lookup.js";

let page = start();
let version = null; // the last that the server told of
let refreshing = false;

const send = async (address, body) => {
  element("work-message").textContent = "";
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
  const options = given.map((field) => (field.type === "checkbox" ? field.dataset.flag : `${field.dataset.flag} ${field.value}%`));
  return [words, component, ...options].filter(Boolean).join(" ");
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

// A component, or one setting of it, with the boxes of the form as they are.
const measureOf = (names, setting = "") => {
  const form = element("measure");
  const body = { ...bodyOf(form), components: names, together: names.length > 1 };
  for (const end of ["first", "last"]) body[end] = setting === "" ? null : Number(setting);
  body.step = null;
  return send("do/measure", body).catch((problem) => say(problem.message));
};

// --- levels

const cardOf = (id) => page.cards.find((card) => card.id === id);
const previews = new WeakMap(); // by edit on the page: what was shown, in the order in which it is written
const levelOf = (plot) => ({ component: plot.component, index: plot.index, level: `${plot.text} ${plot.unit}` });

const showPreview = async (edit, levels) => {
  const answers = [];
  const problems = [];
  for (const level of levels) {
    try {
      answers.push({ level, ...(await send("level", level)) });
    } catch (problem) {
      problems.push(problem.message);
    }
  }
  const differences = answers.map((answer) => answer.difference).join("");
  const nothing = problems.length > 0 ? "Nothing can be written." : "The manifest says so already.";
  previews.set(edit, answers);
  edit.querySelector(".difference").textContent = differences || nothing;
  edit.querySelector(".follows").textContent = [...problems, ...answers.flatMap((answer) => [answer.command, answer.text])].join("\n");
  edit.querySelector(".write").hidden = problems.length > 0 || differences === "";
  edit.hidden = false;
};

// Each level is written onto the text that was shown, or that the level before it left.
const write = async (edit) => {
  const answers = previews.get(edit) ?? [];
  let digest = answers[0]?.digest;
  try {
    for (const { level, difference } of answers) {
      if (difference !== "") digest = (await send("level", { ...level, digest })).after;
    }
    edit.hidden = true;
    say("Written into the manifest.");
  } catch (problem) {
    edit.querySelector(".follows").textContent = problem.message;
  }
};

// --- what runs

const showWork = (work) => {
  if (work.number === 0) return;
  const isRunning = work.ending === "";
  element("work").dataset.state = `${work.number}${work.ending}`; // what a page that has caught up begins its version with
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
  const form = event.target;
  event.preventDefault();
  if (form.dataset.action) begin(form);
  if (form.dataset.for) measureOf(form.dataset.for.split(" "), form.elements.setting.value);
});
document.addEventListener("input", (event) => {
  const form = event.target.closest("form[data-action]");
  if (form) showWords(form);
});
document.addEventListener("line", (event) => {
  const edit = element(event.detail.id).querySelector("[data-edit] .edit");
  edit.hidden = true; // what was shown is not what would be written now
});
document.addEventListener("click", (event) => {
  const button = event.target.closest("button");
  if (!button) return;
  const { preview, component, index, level, measure, way } = button.dataset;
  const edit = button.closest("[data-edit]")?.querySelector(".edit");
  if (button.id === "work-stop") send("stop", {}).catch((problem) => say(problem.message));
  if (preview) showPreview(edit, wanted(cardOf(preview)).map(levelOf));
  if (component) showPreview(edit, [{ component, index, level }]);
  if (button.classList.contains("write")) write(edit);
  if (measure) measureOf([measure]);
  if (way) element(way).querySelector("button").focus();
});
