// Writes onto the page only the server's news: what is open, typed, moved or pointed at stays.

const keyOf = (node) => node.dataset?.key ?? node.nodeName;

const isLeaf = (node) => node.childElementCount === 0;

const setAttributes = (live, before, after) => {
  for (const { name, value } of after.attributes) {
    if (before.getAttribute(name) !== value) live.setAttribute(name, value);
  }
  for (const { name } of before.attributes) {
    if (!after.hasAttribute(name)) live.removeAttribute(name);
  }
};

// Children that are there already, by key, and in order where several have the same key.
const childrenByKey = (live, before) => {
  const known = new Map();
  [...before.childNodes].forEach((node, at) => {
    const key = keyOf(node);
    if (!known.has(key)) known.set(key, []);
    known.get(key).push([live.childNodes[at], node]);
  });
  return known;
};

const patchChildren = (live, before, after) => {
  const known = childrenByKey(live, before);
  const wanted = [...after.childNodes].map((node) => {
    const pair = known.get(keyOf(node))?.shift();
    if (!pair) return document.importNode(node, true);
    patch(...pair, node);
    return pair[0];
  });
  for (const pairs of known.values()) pairs.forEach(([node]) => node.remove());
  wanted.forEach((node, at) => {
    if (live.childNodes[at] !== node) live.insertBefore(node, live.childNodes[at] ?? null);
  });
};

// `live` is what the page made of `before`; where `after` says the same, it is not touched.
export const patch = (live, before, after) => {
  if (before.isEqualNode(after)) return;
  if (live.nodeType !== Node.ELEMENT_NODE) {
    live.data = after.data;
    return;
  }
  setAttributes(live, before, after);
  if (isLeaf(before) && isLeaf(after)) live.textContent = after.textContent;
  else if (live.childNodes.length === before.childNodes.length) patchChildren(live, before, after);
  else live.replaceChildren(...document.importNode(after, true).childNodes); // another program added to it
};
