// What the page says of the lines: of a plot, of its card, and of every platform.
import { heightOf } from "./axis.js";
import { counts, fixedOtherwise, leastReserve, notAchieved, reserveOf, totalOf, wanted } from "./lookup.js";

export const element = (id) => document.getElementById(id);

const figure = (value, places = 2) => String(Number(value.toFixed(places)));
const inProcessors = (hundredths) => `${figure(hundredths / 100)} LP`;
const shareOfProcessors = (reserve, processors) => `${reserve} % of its ${processors} VP${processors === 1 ? "" : "s"}`;
const shareOfHost = (share) => figure(share, 1);
const inWords = (plot) => `${plot.direction.replace("_", " ")} ${plot.text} ${plot.unit}`;

const markOf = (plot) => (element(`${plot.id}-foot`).getAttribute("visibility") === "hidden" ? null : element(`${plot.id}-mark`).querySelector("rect"));

// Labels that a pill would cover, even in part, are not shown: looked at once a frame, since looking is dear.
const covered = (pill, labels) => {
  const over = pill?.getBoundingClientRect() ?? new DOMRect(-1e6, -1e6); // one that is not shown covers nothing
  return [...element(labels).querySelectorAll(":scope > text")].map((label) => {
    const box = label.getBoundingClientRect();
    return [label, box.left < over.right + 4 && over.left < box.right + 4 && box.top < over.bottom && over.top < box.bottom];
  });
};

const crowded = new Set();
const makeRoom = () => {
  const found = [...crowded].flatMap((plot) => [
    ...covered(element(`${plot.id}-value`), `${plot.id}-values`),
    ...covered(markOf(plot), `${plot.id}-reserves`),
  ]);
  for (const [label, hidden] of found) label.setAttribute("visibility", hidden ? "hidden" : "visible");
  crowded.clear();
};
export const makeRoomSoon = (plot) => {
  if (crowded.size === 0) requestAnimationFrame(makeRoom);
  crowded.add(plot);
};

export const showPlot = (plot) => {
  const reserve = leastReserve([plot]);
  const line = element(`${plot.id}-line`);
  const cost = reserve === null ? "no measured reserve is enough" : `needs ${inProcessors(reserve * plot.card.processors)} (${shareOfProcessors(reserve, plot.card.processors)})`;
  line.style.top = `${100 - 100 * heightOf(plot, Number(plot.text))}%`;
  line.setAttribute("aria-valuenow", plot.text);
  line.setAttribute("aria-valuetext", `${inWords(plot)} ${cost}`);
  element(`${plot.id}-value`).textContent = `${plot.text} ${plot.unit}`;
  for (const id of [`${plot.id}-drop`, `${plot.id}-foot`]) {
    element(id).setAttribute("visibility", reserve === null ? "hidden" : "visible");
  }
  if (reserve !== null) {
    for (const end of ["x1", "x2"]) element(`${plot.id}-drop`).setAttribute(end, `${reserve}%`);
    element(`${plot.id}-mark`).setAttribute("x", `${reserve}%`);
    element(`${plot.id}-reserve`).textContent = inProcessors(reserve * plot.card.processors);
  }
  makeRoomSoon(plot);
};

// What is written is the level alone, here as by `rarms select`.
const fixedSentence = (card) =>
  card.fixed.length > 0 && card.plots.some((plot) => plot.moved) ? ` The manifest fixes the reserve of ${card.fixed.join(", ")}: with cpu: { reserve: measured } it follows the level.` : "";

const levelSentence = (card, reserve) => {
  if (reserve === undefined) return "There is no APT yet: move a line to see what a level needs.";
  const short = wanted(card).filter((plot) => leastReserve([plot]) === null);
  if (reserve === null && short.length === 0) return "No reserve at which all of it was measured is enough.";
  if (short.length > 0) return `Not achieved at any reserve that was measured: ${short.map(inWords).join(", ")}.`;
  if (leastReserve(wanted(card)) < reserve) return "The manifest fixes more for one of its components.";
  const deciding = wanted(card).filter((plot) => leastReserve([plot]) === reserve);
  const measured = deciding.every((plot) => plot.measured.includes(reserve));
  const where = deciding.map((plot) => `${plot.component} ${plot.index} ${inWords(plot)}`).join(", ");
  return `For ${where}. ${measured ? "Measured." : "Interpolated: not itself measured."}`;
};

const manifestLines = (card) => {
  const lines = ["components:"];
  for (const name of [...new Set(wanted(card).map((plot) => plot.component))]) {
    lines.push(`  ${name}:`, "    apt:");
    for (const plot of wanted(card).filter((one) => one.component === name)) {
      lines.push(`      ${plot.index}: { ${plot.direction}: ${plot.text} ${plot.unit} }`);
    }
  }
  return lines.length > 1 ? lines : [];
};

// The command that writes a level.
export const commandOf = (page, { component, index, level }) => {
  const plots = page.cards.flatMap((card) => card.plots).filter((plot) => plot.component === component);
  const isOnly = plots.every((plot) => plot.index === index && plot.apt);
  return `rarms select ${component} --at "${level}"${isOnly ? "" : ` --index ${index}`}${page.manifestOptions}`;
};

export const levelOf = (plot) => ({ component: plot.component, index: plot.index, level: `${plot.text} ${plot.unit}` });

const fill = (id, lines) => {
  element(id).textContent = lines.join("\n") || "Move a line first.";
};

export const showCard = (page, card) => {
  if (card.plots.length === 0) return;
  card.reserve = reserveOf(card);
  const reserve = card.reserve;
  element(`${card.id}-reserve`).textContent =
    reserve === undefined ? (card.fixed.length > 0 ? "Reserve fixed by the manifest" : "No reserve yet") : reserve === null ? "Not achieved" : `Reserve ${inProcessors(reserve * card.processors)}`;
  element(`${card.id}-bandwidth`).textContent = reserve ? shareOfProcessors(reserve, card.processors) : "";
  element(`${card.id}-level`).textContent = levelSentence(card, reserve) + fixedSentence(card);
  element(`${card.id}-reset`).hidden = !card.plots.some((plot) => plot.moved);
  fill(`${card.id}-manifest`, manifestLines(card));
  fill(`${card.id}-command`, wanted(card).map((plot) => commandOf(page, levelOf(plot))));
};

export const textOf = (node, text) => {
  if (node.textContent !== text) node.textContent = text; // nothing is laid out again for the same words
};

export const showTotals = (page) => {
  page.capacities.forEach((capacity, place) => {
    const total = totalOf(capacity, page.cards);
    const unknown = notAchieved(capacity, page.cards).map((card) => card.name);
    const headroom = capacity.capacity - total;
    const share = (amount) => `${inProcessors(amount)} (${shareOfHost(amount / capacity.processors)} % of ${capacity.name})`;
    const fits = headroom >= 0 && unknown.length === 0;
    const why = `${unknown.join(", ")} ${unknown.length > 1 ? "are" : "is"} not achieved`;
    const room = unknown.length > 0 ? `not known: ${why}` : share(headroom);
    const message = headroom >= 0 ? `Headroom of ${capacity.name}: ${room}` : `Over ${capacity.name} by ${unknown.length > 0 ? "at least " : ""}${share(-headroom)}`;
    const fit = element(`fit-${place + 1}`);
    const sentence = fit.querySelector(".sentence");
    const reserved = `${unknown.length > 0 ? "At least " : ""}${inProcessors(total)} of ${capacity.processors} LP reserved`;
    const otherwise = fixedOtherwise(capacity, page.cards).map((card) => card.name);
    const fixed = otherwise.length > 0 ? ` This counts ${otherwise.join(", ")} by the lines; the manifest fixes another reserve, which stays until it says measured.` : "";
    textOf(sentence, `${reserved} (${shareOfHost(total / capacity.processors)} % of ${capacity.name})${capacity.otherClaims}. ${message}.${fixed}`);
    sentence.classList.toggle("over-full", !fits);
    fit.querySelector(".used").setAttribute("width", Math.min(total / capacity.processors, 100).toFixed(3));
    fit.querySelector(".used").classList.toggle("over", !fits);
    for (const card of page.cards.filter((plotted) => plotted.platform === capacity.platform && plotted.plots.length > 0)) {
      const headroom = element(`${card.id}-headroom`);
      textOf(headroom, counts(card) ? `${message}.` : "");
      headroom.classList.toggle("over-full", !fits);
    }
  });
};
