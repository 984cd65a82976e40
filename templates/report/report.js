"use strict";
// Moves the lines. What a threshold reserves is looked up in the planner's own table, by the planner's own scan.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const element = (id) => document.getElementById(id);
  const withState = (plot, card) => ({
    ...plot,
    card,
    safe: new Map(plot.rows.map(([reserve, , safe]) => [reserve, safe])),
    text: plot.start,
    moved: false,
  });
  const plots = data.cards.flatMap((card) => card.plots.map((plot) => withState(plot, card)));
  const plotsOf = (card) => plots.filter((plot) => plot.card === card);

  // --- looking up

  const meets = (plot, safe, threshold) => (plot.direction === "at_most" ? safe <= threshold : safe >= threshold);

  // The least whole per cent at which all these plots were looked up and all meet their thresholds, or null.
  const leastReserve = (some) => {
    for (let reserve = 1; reserve <= 100; reserve += 1) {
      const safe = some.map((plot) => plot.safe.get(reserve) ?? null);
      if (safe.every((value, at) => value !== null && meets(some[at], value, Number(some[at].text)))) return reserve;
    }
    return null;
  };

  const wanted = (card) => plotsOf(card).filter((plot) => plot.apt || plot.moved);

  // The reserve with which every threshold of a card holds: null where none does, undefined where none is asked for.
  const reserveOf = (card) => {
    const least = wanted(card).length === 0 ? undefined : leastReserve(wanted(card));
    return typeof least === "number" ? Math.max(least, card.floor) : least;
  };

  const counts = (card) => card.decides || (card.fixed.length > 0 && plotsOf(card).some((plot) => plot.moved));

  // In hundredths of a logical processor.
  const totalOf = (capacity) => {
    const cards = data.cards.filter((card) => card.platform === capacity.platform && counts(card));
    const replaced = new Set(cards.flatMap((card) => card.fixed));
    const remaining = capacity.fixed.filter(([names]) => !names.every((name) => replaced.has(name)));
    const fixed = remaining.reduce((sum, [, amount]) => sum + amount, capacity.other);
    return cards.reduce((sum, card) => sum + (reserveOf(card) ?? 0) * card.processors, fixed);
  };

  // --- the grid and the axis

  // The number of a step as the manifest would write it, without ever rounding: a whole number with its point moved.
  const written = (plot, number) => {
    const whole = number * plot.mantissa;
    if (plot.exponent >= 0) return String(whole * 10 ** plot.exponent);
    const places = -plot.exponent;
    const figures = String(whole).padStart(places + 1, "0");
    return `${figures.slice(0, -places)}.${figures.slice(-places)}`.replace(/\.?0+$/, "");
  };

  const step = (plot) => plot.mantissa * 10 ** plot.exponent;
  const bounded = (plot, number) => Math.min(Math.max(number, plot.first), plot.last);
  const scaled = (plot, value) => (plot.logarithmic ? Math.log10(value) : value);

  const heightOf = (plot, value) => {
    const inside = Math.min(Math.max(value, plot.low), plot.high);
    return (scaled(plot, inside) - scaled(plot, plot.low)) / (scaled(plot, plot.high) - scaled(plot, plot.low));
  };

  const valueAt = (plot, height) => {
    const at = scaled(plot, plot.low) + height * (scaled(plot, plot.high) - scaled(plot, plot.low));
    return plot.logarithmic ? 10 ** at : at;
  };

  // --- showing

  const figure = (value, places = 2) => String(Number(value.toFixed(places)));
  const inProcessors = (hundredths) => `${figure(hundredths / 100)} LP`;
  const shareOfProcessors = (reserve, processors) => `${reserve} % of its ${processors} VP${processors === 1 ? "" : "s"}`;
  const shareOfHost = (share) => figure(share, 1);
  const inWords = (plot) => `${plot.direction.replace("_", " ")} ${plot.text} ${plot.unit}`;

  // Labels that a pill would cover, even in part, are not shown: looked at once a frame, since looking is dear.
  const covered = (pill, labels) => {
    const over = pill.getBoundingClientRect();
    return [...element(labels).querySelectorAll(":scope > text")].map((label) => {
      const box = label.getBoundingClientRect();
      return [label, box.left < over.right + 4 && over.left < box.right + 4 && box.top < over.bottom && over.top < box.bottom];
    });
  };

  const crowded = new Set();
  const makeRoom = () => {
    const found = [...crowded].flatMap((plot) => [
      ...covered(element(`${plot.id}-value`), `${plot.id}-values`),
      ...covered(element(`${plot.id}-mark`).querySelector("rect"), `${plot.id}-reserves`),
    ]);
    for (const [label, hidden] of found) label.setAttribute("visibility", hidden ? "hidden" : "visible");
    crowded.clear();
  };
  const makeRoomSoon = (plot) => {
    if (crowded.size === 0) requestAnimationFrame(makeRoom);
    crowded.add(plot);
  };

  const showPlot = (plot) => {
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

  const levelSentence = (card, reserve) => {
    if (reserve === undefined) return "There is no APT yet: move a line.";
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
      if (card.fixed.includes(name)) lines.push("    cpu: { reserve: measured }");
    }
    return lines.length > 1 ? lines : [];
  };

  const commandLines = (card) =>
    wanted(card).map((plot) => {
      const several = plotsOf(card).filter((one) => one.component === plot.component).length > 1;
      const index = several || !plot.apt ? ` --index ${plot.index}` : "";
      return `rarms select ${plot.component} --at "${plot.text} ${plot.unit}"${index}`;
    });

  const fill = (id, lines) => {
    element(id).textContent = lines.join("\n") || "Move a line first.";
  };

  const showCard = (card) => {
    if (card.plots.length === 0) return;
    const reserve = reserveOf(card);
    element(`${card.id}-reserve`).textContent =
      reserve === undefined ? "No reserve yet" : reserve === null ? "Not achieved" : `Reserve ${inProcessors(reserve * card.processors)}`;
    element(`${card.id}-bandwidth`).textContent = reserve ? shareOfProcessors(reserve, card.processors) : "";
    element(`${card.id}-level`).textContent = levelSentence(card, reserve);
    element(`${card.id}-reset`).hidden = !plotsOf(card).some((plot) => plot.moved);
    fill(`${card.id}-manifest`, manifestLines(card));
    fill(`${card.id}-command`, commandLines(card));
  };

  const showTotals = () => {
    data.capacities.forEach((capacity, place) => {
      const total = totalOf(capacity);
      const headroom = capacity.capacity - capacity.unmanaged - total;
      const share = (amount) => `${inProcessors(amount)} (${shareOfHost(amount / capacity.processors)} % of ${capacity.name})`;
      const fits = headroom >= 0;
      const message = fits
        ? `Headroom of ${capacity.name}: ${share(headroom)}`
        : `Over ${capacity.name} by ${share(-headroom)}`;
      const fit = element(`fit-${place + 1}`);
      fit.querySelector(".sentence").textContent =
        `${inProcessors(total)} of ${inProcessors(capacity.capacity)} reserved (${shareOfHost(total / capacity.processors)} % of ${capacity.name}). ${message}.`;
      fit.querySelector(".sentence").classList.toggle("over-full", !fits);
      fit.querySelector(".used").setAttribute("width", Math.min(total / capacity.processors, 100).toFixed(3));
      fit.querySelector(".used").classList.toggle("over", !fits);
      for (const card of data.cards.filter((plotted) => plotted.platform === capacity.platform && plotted.plots.length > 0)) {
        const headroom = element(`${card.id}-headroom`);
        headroom.textContent = counts(card) ? `${message}.` : "";
        headroom.classList.toggle("over-full", !fits);
      }
    });
  };

  const show = (plot) => {
    showPlot(plot);
    showCard(plot.card);
    showTotals();
  };

  // --- moving

  const moveTo = (plot, number) => {
    plot.text = written(plot, bounded(plot, number));
    plot.moved = true;
    show(plot);
  };

  const nearest = (plot) => Number(plot.text) / step(plot);

  // From a threshold beside the grid, the next step in that direction.
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

  const movable = (plot) => {
    const line = element(`${plot.id}-line`);
    let held = null; // by which pointer, and how far from the line it was taken hold of
    line.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || held !== null) return;
      const box = line.getBoundingClientRect();
      held = { by: event.pointerId, offset: event.clientY - (box.top + box.height / 2) };
      line.setPointerCapture(event.pointerId);
    });
    // Where a browser takes the capture away, the line still follows.
    addEventListener("pointermove", (event) => {
      if (held?.by === event.pointerId) toPointer(plot, event, held.offset);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      addEventListener(end, (event) => {
        if (held?.by === event.pointerId) held = null;
      });
    }
    line.addEventListener("keydown", (event) => onKey(plot, event));
    element(`${plot.id}-field`).addEventListener("click", (event) => {
      if (!line.contains(event.target)) toPointer(plot, event);
    });
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
    for (const plot of plotsOf(card)) {
      plot.text = plot.start;
      plot.moved = false;
      showPlot(plot);
    }
    showCard(card);
    showTotals();
  };

  plots.forEach(movable);
  plots.forEach(showPlot);
  data.cards.forEach(showCard);
  showTotals();
  addEventListener("resize", () => plots.forEach(makeRoomSoon));
  for (const card of data.cards.filter((one) => one.plots.length > 0)) {
    element(`${card.id}-reset`).addEventListener("click", () => reset(card));
  }
  for (const button of document.querySelectorAll("[data-copy]")) button.addEventListener("click", () => copy(button));
})();
