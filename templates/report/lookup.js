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

// How a threshold stands by this card's own load, by the rule of rarms' verdict: missed where it is at the highest setting.
export const achievementOf = (plot) => {
  if (leastReserve([plot]) !== null) return "met";
  const isMissed = plot.best === "none" || (plot.best !== undefined && !meets(plot, plot.best, Number(plot.text)));
  return isMissed ? "not achieved" : "inconclusive";
};

// The verdict on a card's lines: rarms' own where none was moved, else what this card's load alone says.
export const verdictOf = (card) => {
  if (card.achievement && !card.plots.some((plot) => plot.moved)) return card.achievement;
  const achievements = wanted(card).map(achievementOf);
  const found = ["not achieved", "inconclusive"].find((achievement) => achievements.includes(achievement));
  if (found) return found;
  if (leastReserve(wanted(card)) === null) return "inconclusive";
  return card.notMeasured ? "not measured" : "met";
};

export const wordsOf = (card) => {
  const verdict = verdictOf(card);
  return verdict === "not measured" && card.notMeasured ? `${verdict} with ${inARow(card.notMeasured)}` : verdict;
};

export const inARow = (words) => (words.length > 1 ? `${words.slice(0, -1).join(", ")} and ${words.at(-1)}` : words.join(""));

const MOST_NAMES = 4; // of a message, as rarms' own lists are cut

export const listNames = (names) => (names.length > MOST_NAMES + 1 ? `${names.slice(0, MOST_NAMES).join(", ")} and ${names.length - MOST_NAMES} more` : inARow(names));

export const wanted = (card) => card.plots.filter((plot) => plot.apt || plot.moved);

// The reserve with which every threshold of a card holds: null where it is not known, undefined where none is asked for.
export const reserveOf = (card) => {
  if (wanted(card).length === 0) return undefined;
  return verdictOf(card) === "met" ? Math.max(leastReserve(wanted(card)), card.floor) : null;
};

export const counts = (card) => card.decides || (card.fixed.length > 0 && card.plots.some((plot) => plot.moved));

const counted = (capacity, cards) => cards.filter((card) => card.platform === capacity.platform && counts(card));

// Why the total is not known, worst first: components whose reservation is not known, by how they stand.
export const whyNotKnown = (capacity, cards) => {
  const open = counted(capacity, cards).filter((card) => card.reserve === null).map((card) => [card.name, wordsOf(card)]);
  const named = new Map();
  for (const [name, words] of [...open, ...capacity.unknown]) named.set(words, [...(named.get(words) ?? []), name]);
  const order = ["not achieved", "inconclusive", "not measured"];
  const rank = ([words]) => order.findIndex((each) => words.startsWith(each));
  return [...named].sort((one, other) => rank(one) - rank(other)).map(([words, found]) => `${listNames(found)} ${found.length > 1 ? "are" : "is"} ${words}`).join("; ");
};

// The cards whose lines count in the total though the manifest fixes their reserve: writing their level leaves it.
export const fixedOtherwise = (capacity, cards) => counted(capacity, cards).filter((card) => !card.decides && card.reserve !== null);

// In hundredths of a logical processor, without those that are not known: what the manifest fixes for these stays.
// `reserve` of a card is what `reserveOf` said of it last.
export const totalOf = (capacity, cards) => {
  const here = counted(capacity, cards).filter((card) => card.reserve !== null);
  const replaced = new Set(here.flatMap((card) => card.fixed));
  const remaining = capacity.fixed.filter(([names]) => !names.every((name) => replaced.has(name)));
  const fixed = remaining.reduce((sum, [, amount]) => sum + amount, capacity.other);
  return here.reduce((sum, card) => sum + (card.reserve ?? 0) * card.processors, fixed);
};
