// How lines are moved: by mouse, finger and keys; and what else can be clicked without a server.
import { bounded, heightOf, step, valueAt, written } from "./axis.js";
import { readCards } from "./lookup.js";
import { element, makeRoomSoon, showCard, showPlot, showTotals } from "./show.js";

const page = { capacities: [], cards: [], manifestOptions: "" };
const plots = () => page.cards.flatMap((card) => card.plots);

const show = (plot) => {
  showPlot(plot);
  showCard(page, plot.card);
  showTotals(page);
  document.dispatchEvent(new CustomEvent("line", { detail: plot.card }));
};

const moveTo = (plot, number) => {
  plot.text = written(plot, bounded(plot, number));
  plot.moved = true;
  show(plot);
};

const nearest = (plot) => Number(plot.text) / step(plot);

// From a threshold off the grid, the next step in that direction.
const moveBy = (plot, steps) => {
  const at = nearest(plot);
  const on = Math.abs(at - Math.round(at)) < 1e-6 ? Math.round(at) : steps > 0 ? Math.floor(at) : Math.ceil(at);
  moveTo(plot, on + steps);
};

const KEYS = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 10, PageDown: -10 };

const onKey = (plot, event) => {
  if (event.altKey || event.ctrlKey || event.metaKey) return;
  if (event.key in KEYS) moveBy(plot, KEYS[event.key]);
  else if (event.key === "Home") moveTo(plot, plot.first);
  else if (event.key === "End") moveTo(plot, plot.last);
  else return;
  event.preventDefault();
};

const toPointer = (plot, event, offset = 0) => {
  const field = element(`${plot.id}-field`).getBoundingClientRect();
  const height = 1 - (event.clientY - offset - field.top) / field.height;
  moveTo(plot, Math.round(valueAt(plot, Math.min(Math.max(height, 0), 1)) / step(plot)));
};

let held = null; // which line, by which pointer, and how far from the line it was taken hold of

// Whether a line is being dragged.
export const isHeld = () => held !== null;

const plotOf = (target) => plots().find((plot) => plot.id === target.closest("[data-plot]")?.dataset.plot);

const hold = (line, event) => {
  if (event.button !== 0 || held !== null) return;
  const box = line.getBoundingClientRect();
  held = { plot: plotOf(line), by: event.pointerId, offset: event.clientY - (box.top + box.height / 2) };
  line.setPointerCapture(event.pointerId);
};

const copy = async (button) => {
  const text = element(button.dataset.copy);
  try {
    await navigator.clipboard.writeText(text.textContent);
  } catch {
    getSelection().selectAllChildren(text); // where the clipboard is out of reach: the old way
    document.execCommand("copy");
  }
  button.textContent = "Copied";
  setTimeout(() => (button.textContent = "Copy"), 1500);
};

const reset = (card) => {
  for (const plot of card.plots) {
    plot.text = plot.start;
    plot.moved = false;
    showPlot(plot);
  }
  showCard(page, card);
  showTotals(page);
  document.dispatchEvent(new CustomEvent("line", { detail: card }));
};

// --- samples of a setting

const showSamples = (plot, number) => {
  const { reserve, low, high, counts } = plot.samples[number];
  const most = Math.max(...counts);
  const figure = element(`${plot.id}-samples`);
  const total = counts.reduce((sum, count) => sum + count, 0);
  const text = `${total} response times at a reserve of ${reserve} %: ${low} to ${high} ms, at most ${most} in a bar.`;
  figure.querySelector("figcaption").textContent = text;
  const width = 100 / counts.length;
  const drawing = figure.querySelector("svg");
  const bars = counts.map((count, at) => {
    const bar = document.createElementNS(drawing.namespaceURI, "rect");
    const height = (100 * count) / most;
    for (const [name, value] of Object.entries({ x: at * width, y: 100 - height, width: width * 0.9, height })) bar.setAttribute(name, value);
    return bar;
  });
  drawing.replaceChildren(...bars);
  figure.hidden = false;
};

// --- beginning

const begin = (card) => {
  card.plots.forEach(showPlot);
  showCard(page, card);
};

const identityOf = (plot) => `${plot.card.log} ${plot.component} ${plot.index}`;

// Reads the page's data, and brings its lines to life; lines that were moved stay where they are.
export const start = () => {
  const moved = new Map(plots().filter((plot) => plot.moved).map((plot) => [identityOf(plot), plot.text]));
  const data = JSON.parse(element("data").textContent);
  page.capacities = data.capacities;
  page.manifestOptions = data.manifest_options;
  page.cards = readCards(data);
  for (const plot of plots().filter((each) => moved.has(identityOf(each)))) {
    plot.text = moved.get(identityOf(plot));
    plot.moved = !plot.apt || plot.text !== plot.start; // what was written is the manifest's own by now
  }
  page.cards.forEach(begin);
  showTotals(page);
  return page;
};

// Where a browser takes a pointer's capture away, the line still follows.
addEventListener("pointermove", (event) => {
  if (held?.by === event.pointerId) toPointer(held.plot, event, held.offset);
});
for (const end of ["pointerup", "pointercancel"]) {
  addEventListener(end, (event) => {
    if (held?.by === event.pointerId) held = null;
  });
}
addEventListener("resize", () => plots().forEach(makeRoomSoon));

// NOTE: on the document, not on each element: elements may come and go while the page follows the files.
document.addEventListener("pointerdown", (event) => {
  const line = event.target.closest(".line");
  if (line) hold(line, event);
});
document.addEventListener("keydown", (event) => {
  const line = event.target.closest(".line");
  if (line) onKey(plotOf(line), event);
});
document.addEventListener("click", (event) => {
  const copied = event.target.closest("[data-copy]");
  const setting = event.target.closest("[data-setting]");
  const restored = event.target.closest("[data-reset]");
  if (copied) copy(copied);
  if (setting) showSamples(plotOf(setting), Number(setting.dataset.setting));
  else if (event.target.closest(".field") && !event.target.closest(".line")) toPointer(plotOf(event.target), event);
  if (restored) reset(page.cards.find((card) => card.id === restored.dataset.reset));
});
