// What the page says of the lines: of a plot, of its card, and of every platform.
import { heightOf } from "./axis.js";
import { counts, fixedOtherwise, leastReserve, reserveOf, achievementOf, totalOf, verdictOf, wanted, whyNotKnown, wordsOf } from "./lookup.js";

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
  const cost = reserve === null ? achievementOf(plot) : `needs ${inProcessors(reserve * plot.card.processors)} (${shareOfProcessors(reserve, plot.card.processors)})`;
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
  card.fixed.length > 0 && card.plots.some((plot) => plot.moved) ? ` The manifest fixes the reserve of ${card.fixed.join(", ")}. To follow the level, set cpu: { reserve: measured }.` : "";

const capitalised = (text) => text[0].toUpperCase() + text.slice(1);

// The thresholds that stand as the card does; where loads are not measured yet, what is enough with the others.
const whyUnknown = (card) => {
  const verdict = verdictOf(card);
  const short = wanted(card).filter((plot) => achievementOf(plot) === verdict);
  if (verdict === "not measured") return `With ${card.load}: ${inProcessors(leastReserve(wanted(card)) * card.processors)}.`;
  if (short.length === 0) return "No reserve meets all thresholds together with 99 % confidence.";
  return `${capitalised(verdict)}: ${short.map((plot) => `${plot.component} ${plot.index} ${inWords(plot)}`).join(", ")}.`;
};

// Only the card that the verdict is of says a reservation in large type.
const headline = (card, reserve) => {
  if (reserve === undefined) return card.fixed.length > 0 ? "Reserve fixed by the manifest" : "No reserve yet";
  const amount = reserve === null ? capitalised(wordsOf(card)) : `Reserve ${inProcessors(reserve * card.processors)}`;
  if (!card.aside) return amount;
  return `With ${card.load} alone: ${reserve === null ? wordsOf(card) : inProcessors(reserve * card.processors)}`;
};

const levelSentence = (card, reserve) => {
  if (reserve === undefined) return "The component has no threshold yet. Move a line to see the reserve for a level.";
  if (reserve === null) return whyUnknown(card);
  if (leastReserve(wanted(card)) < reserve) return "The manifest fixes a larger reserve for one of its components.";
  const deciding = wanted(card).filter((plot) => leastReserve([plot]) === reserve);
  const measured = deciding.every((plot) => plot.measured.includes(reserve));
  const where = deciding.map((plot) => `${plot.component} ${plot.index} ${inWords(plot)}`).join(", ");
  return `For ${where}. ${measured ? "Measured." : "Interpolated, not measured."}`;
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
  element(`${card.id}-reserve`).textContent = headline(card, reserve);
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
    const unknown = whyNotKnown(capacity, page.cards);
    const headroom = capacity.capacity - total;
    const share = (amount) => `${inProcessors(amount)} (${shareOfHost(amount / capacity.processors)} % of ${capacity.name})`;
    const fits = headroom >= 0 && unknown === "";
    const room = unknown ? `not known: ${unknown}` : share(headroom);
    const message = headroom >= 0 ? `Headroom of ${capacity.name}: ${room}` : `Over ${capacity.name} by ${unknown ? "at least " : ""}${share(-headroom)}`;
    const fit = element(`fit-${place + 1}`);
    const sentence = fit.querySelector(".sentence");
    const reserved = `${unknown ? "At least " : ""}${inProcessors(total)} of ${capacity.processors} LP reserved`;
    const otherwise = fixedOtherwise(capacity, page.cards).map((card) => card.name);
    const fixed = otherwise.length > 0 ? ` This counts ${otherwise.join(", ")} by the lines. The manifest fixes a different reserve. To follow the lines, set cpu: { reserve: measured }.` : "";
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
