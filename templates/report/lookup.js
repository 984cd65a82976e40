// What thresholds reserve: looked up in the planner's own table, by the planner's own scan.

const withState = (plot, card) => ({
  ...plot,
  card,
  safe: new Map(plot.rows),
  text: plot.start,
  moved: false,
});

// The page's cards, with the state of their lines.
export const readCards = (data) =>
  data.cards.map((each) => {
    const card = { ...each };
    card.plots = each.plots.map((plot) => withState(plot, card));
    return card;
  });

const meets = (plot, safe, threshold) => (plot.direction === "at_most" ? safe <= threshold : safe >= threshold);

// The least whole per cent at which all these plots were looked up and all meet their thresholds, or null.
export const leastReserve = (plots) => {
  const thresholds = plots.map((plot) => Number(plot.text));
  for (let reserve = 1; reserve <= 100; reserve += 1) {
    const safe = plots.map((plot) => plot.safe.get(reserve) ?? null);
    if (safe.every((value, at) => value !== null && meets(plots[at], value, thresholds[at]))) return reserve;
  }
  return null;
};

export const wanted = (card) => card.plots.filter((plot) => plot.apt || plot.moved);

// The reserve with which every threshold of a card holds: null where none does, undefined where none is asked for.
export const reserveOf = (card) => {
  const least = wanted(card).length === 0 ? undefined : leastReserve(wanted(card));
  return typeof least === "number" ? Math.max(least, card.floor) : least;
};

export const counts = (card) => card.decides || (card.fixed.length > 0 && card.plots.some((plot) => plot.moved));

const counted = (capacity, cards) => cards.filter((card) => card.platform === capacity.platform && counts(card));

// The cards whose lines no measured reserve achieves: what they need, and with it the total, is not known.
export const notAchieved = (capacity, cards) => counted(capacity, cards).filter((card) => card.reserve === null);

// The cards whose lines count in the total though the manifest fixes their reserve: writing their level leaves it.
export const fixedOtherwise = (capacity, cards) => counted(capacity, cards).filter((card) => !card.decides && card.reserve !== null);

// In hundredths of a logical processor, without those that are not achieved: what the manifest fixes for these stays.
// `reserve` of a card is what `reserveOf` said of it last.
export const totalOf = (capacity, cards) => {
  const here = counted(capacity, cards).filter((card) => card.reserve !== null);
  const replaced = new Set(here.flatMap((card) => card.fixed));
  const remaining = capacity.fixed.filter(([names]) => !names.every((name) => replaced.has(name)));
  const fixed = remaining.reduce((sum, [, amount]) => sum + amount, capacity.other);
  return here.reduce((sum, card) => sum + (card.reserve ?? 0) * card.processors, fixed);
};
