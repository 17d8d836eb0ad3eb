// The motor nodes' states in words.

const ROWS = [
  ["drive", (n) => n.drive, (n) => n.drive.includes("fault")],
  ["NMT", (n) => n.nmt, () => false],
  ["limits", (n) => n.limits?.join(", ") || "none", (n) => n.limits?.length > 0],
  ["emergency", (n) => (n.emergency ? `${n.emergency} (${n.emergencies} so far)` : "none"),
    (n) => Boolean(n.emergency)],
  ["missed SYNC", (n) => `${n.missed_sync}`, (n) => n.missed_sync > 0],
  ["temperature", (n) => `${n.temperature_C?.toFixed(1)} °C`, () => false],
];
const UNKNOWN = "not logged (--log states)";

function element(tag, text = "", className = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  made.className = className;
  return made;
}

// Writes only what has changed: the browser lays out anew for everything else.
function set(target, text, className) {
  if (target.textContent !== text) target.textContent = text;
  if (target.className !== className) target.className = className;
}

class Card {
  constructor(node) {
    this.box = element("article", "", "node");
    this.phase = element("span");
    const title = element("h2", `Node ${node}`);
    title.append(this.phase);
    const list = element("dl");
    this.values = ROWS.map(([label]) => {
      const value = element("dd");
      list.append(element("dt", label), value);
      return value;
    });
    this.box.append(title, list);
  }

  draw(node, convergence) {
    const enabled = node.drive === "operation enabled";
    const fault = node.drive.includes("fault");
    set(this.phase, enabled ? (convergence ? "convergence" : "divergence") : "",
      `phase ${convergence ? "convergence" : "divergence"}`);
    const kind = `node${fault ? " fault" : enabled ? " enabled" : ""}`;
    if (this.box.className !== kind) this.box.className = kind;
    ROWS.forEach(([, value, bad], i) => {
      const known = i === 0 || "nmt" in node;
      set(this.values[i], known ? value(node) : UNKNOWN, known && bad(node) ? "bad" : "");
    });
  }
}

export class NodesView {
  constructor(box) {
    this.cards = [1, 2, 3].map((node) => new Card(node));
    box.append(...this.cards.map((card) => card.box));
  }

  draw(nodes, state) {
    if (!state) return;
    this.cards.forEach((card, i) => {
      // The statusword comes in every period too: all there is where NODE_STATUS is not logged.
      const node = nodes.find((n) => n.node === i + 1) ?? { drive: state.drive[i] };
      card.draw(node, state.convergence[i]);
    });
  }
}
