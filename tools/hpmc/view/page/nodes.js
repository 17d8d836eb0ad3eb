// The motor nodes' states in words.

const ROWS = [
  ["drive", (n) => n.drive, (n) => n.drive.includes("fault")],
  ["NMT", (n) => n.nmt, () => false],
  ["limits", (n) => n.limits.join(", ") || "none", (n) => n.limits.length > 0],
  ["emergency", (n) => (n.emergency ? `${n.emergency} (${n.emergencies} so far)` : "none"),
    (n) => n.emergency !== ""],
  ["missed SYNC", (n) => String(n.missed_sync), (n) => n.missed_sync > 0],
  ["temperature", (n) => `${n.temperature_C.toFixed(1)} °C`, () => false],
];

function element(tag, text = "", className = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  made.className = className;
  return made;
}

export class NodesView {
  constructor(box) {
    this.box = box;
    this.shown = "";
  }

  draw(nodes, state) {
    const convergence = state?.convergence ?? [];
    // The statusword comes in every period too, so this works where NODE_STATUS is not logged.
    const known = nodes.length ? nodes : (state?.drive ?? []).map((drive, i) => ({ node: i + 1, drive }));
    const text = JSON.stringify([known.map(({ t, ...rest }) => rest), convergence]);
    if (text === this.shown) return; // the DOM is slow
    this.shown = text;
    this.box.replaceChildren(...known.map((node) => this.card(node, convergence[node.node - 1])));
  }

  card(node, convergence) {
    const kind = node.drive.includes("fault") ? "fault" : node.drive === "operation enabled" ? "enabled" : "";
    const card = element("article", "", `node ${kind}`);
    const title = element("h2", `Node ${node.node}`);
    if (convergence !== undefined && kind === "enabled") {
      const name = convergence ? "convergence" : "divergence";
      title.append(element("span", name, `phase ${name}`));
    }
    const list = element("dl");
    for (const [label, value, bad] of ROWS.slice(0, "nmt" in node ? ROWS.length : 1)) {
      list.append(element("dt", label), element("dd", value(node), bad(node) ? "bad" : ""));
    }
    card.append(title, list);
    if (!("nmt" in node)) card.append(element("p", "the rest is not in a log of --log states"));
    return card;
  }
}
