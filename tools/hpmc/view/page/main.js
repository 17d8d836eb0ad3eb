import { ArmView, LensView } from "./arm.js";
import { connect } from "./link.js";
import { NodesView } from "./nodes.js";
import { TorqueView } from "./torques.js";

const KEPT_S = 4.5;
const SILENT_MS = 3000;
const SAID_EVERY_MS = 50;
const NUDGE_M = 0.005;
const TARGET_EVERY_MS = 20;
const REACHES = 4; // phase
const PHASES = ["boot", "configuring", "enabling", "approach", "reaching", "stopping"];

const at = (id) => document.getElementById(id);
const arm = new ArmView(at("arm"));
const lens = new LensView(at("lens"));
const torques = [...document.querySelectorAll(".joint")].map((box, i) => new TorqueView(box, i));
const nodesView = new NodesView(at("nodes"));

let hello = null;
let states = [];
let nodes = [];
const WAITING_MAX = 400; // more than a second at the server's rate
let waiting = []; // states that came in and are to be shown in a moment: {due, state}
let between = 50; // ms from message to message, live
let arrival = performance.now();
let playing = true;
let scrubbing = false;
let frozen = false;
let over = false;
let fresh = true;
let lost = 0;
let skipped = 0;
let heard = performance.now();
let wish = null; // target being dragged
let wishSent = 0;
let said = 0;
let clockRatio = null; // simulated s per s, live

// For whoever tests this page.
const stats = { drawn: 0, messages: 0, states: 0, perSecond: 0, drawing_ms: 0 };
window.hpmcView = { stats, get states() { return states; }, get hello() { return hello; }, arm };

const send = connect(onMessage, onClose);

function onMessage(message) {
  heard = performance.now();
  skipped = message.skipped;
  if (message.type === "hello") return greet(message);
  stats.messages += 1;
  stats.states += message.states.length;
  lost = message.lost ?? 0;
  if (frozen) return;
  nodes = message.nodes;
  if ("playhead" in message) {
    if (message.reset) states = [];
    message.states.forEach(keep);
    followPlayer(message);
    fresh = true;
  } else {
    spread(message.states);
  }
}

// A live run's states come a few at a time: they are shown one after the other until the next come.
function spread(arrived) {
  const now = performance.now();
  between = 0.9 * between + 0.1 * Math.min(now - arrival, 2 * between);
  arrival = now;
  arrived.forEach((state, i) => waiting.push({ due: now + (between * i) / arrived.length, state }));
  // A page that is not seen draws nothing, but states still come in.
  if (waiting.length > WAITING_MAX) waiting.splice(0, waiting.length - WAITING_MAX);
}

function release(now) {
  let count = waiting.findIndex(({ due }) => due > now);
  if (count < 0) count = waiting.length;
  if (!count) return;
  waiting.splice(0, count).forEach(({ state }) => keep(state));
  fresh = true;
}

function keep(state) {
  if (states.length && state.t < states.at(-1).t) states = []; // a new run on the same address
  states.push(state);
  while (states[0].t < state.t - KEPT_S) states.shift();
}

function greet(message) {
  hello = message;
  states = [];
  waiting = [];
  fresh = true;
  const replay = hello.kind === "replay";
  at("name").textContent = hello.name;
  document.title = `${hello.name} · H-PMC rig`;
  at("kind").textContent = replay ? "replay" : "live";
  at("kind").className = `badge ${hello.kind}`;
  at("transport").hidden = !replay;
  at("freeze").hidden = replay;
  if (replay) {
    at("scrub").min = hello.begin;
    at("scrub").max = hello.end;
    if (hello.damage.length) notice(`damaged log: ${hello.damage.join("; ")}`);
  }
}

function onClose() {
  over = true;
  at("kind").textContent = hello?.kind === "replay" ? "viewer ended" : "run ended";
  at("kind").className = "badge over";
  notice(hello?.kind === "replay"
    ? "The viewer was ended."
    : "The run or the viewer has ended. To replay it: ./rig view RUN, the folder that the run told.");
}

function notice(text) {
  at("notice").textContent = text;
  at("notice").hidden = !text;
}

// ---- replay ----------------------------------------------------------------------------------

function followPlayer(message) {
  playing = message.playing;
  at("play").textContent = playing ? "❚❚" : "▶";
  at("play").setAttribute("aria-label", playing ? "Pause" : "Play");
  if (!scrubbing) at("scrub").value = message.playhead;
}

at("play").addEventListener("click", () => send({ do: playing ? "pause" : "play" }));
at("speed").addEventListener("change", () => send({ do: "speed", value: Number(at("speed").value) }));
at("scrub").addEventListener("input", () => {
  scrubbing = true;
  send({ do: "seek", t: Number(at("scrub").value) });
});
at("scrub").addEventListener("change", () => { scrubbing = false; });
document.addEventListener("keydown", (event) => {
  if (event.key === " " && hello?.kind === "replay" && event.target.tagName !== "BUTTON") {
    event.preventDefault();
    at("play").click();
  }
});

// ---- live ------------------------------------------------------------------------------------

at("freeze").addEventListener("click", () => {
  frozen = !frozen;
  at("freeze").textContent = frozen ? "Go on" : "Freeze";
});

const mayDrag = () => hello?.kind === "live" && !over && states.at(-1)?.phase === REACHES;

function ask(point) {
  wish = point;
  const now = performance.now();
  if (now - wishSent < TARGET_EVERY_MS) return;
  wishSent = now;
  send({ do: "target", x: point[0], y: point[1] });
}

const canvas = at("arm");
canvas.addEventListener("pointerdown", (event) => {
  if (!mayDrag() || event.button !== 0) return;
  canvas.setPointerCapture(event.pointerId);
  canvas.classList.add("dragging");
  ask(arm.pointOf(event));
});
canvas.addEventListener("pointermove", (event) => {
  if (wish && mayDrag()) ask(arm.pointOf(event));
});
for (const end of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(end, () => {
    if (wish) send({ do: "target", x: wish[0], y: wish[1] });
    wish = null;
    canvas.classList.remove("dragging");
  });
}
canvas.addEventListener("keydown", (event) => {
  const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  if (!step || !mayDrag()) return;
  event.preventDefault();
  const from = states.at(-1).x_t;
  send({ do: "target", x: from[0] + NUDGE_M * step[0], y: from[1] + NUDGE_M * step[1] });
});

// ---- drawing ---------------------------------------------------------------------------------

let second = { began: performance.now(), drawn: 0, t: null };

function perSecond(now) {
  if (now - second.began < 1000) return;
  const wall = (now - second.began) / 1000;
  const t = states.at(-1)?.t ?? null;
  stats.perSecond = (stats.drawn - second.drawn) / wall;
  clockRatio = t !== null && second.t !== null && t > second.t ? (t - second.t) / wall : null;
  second = { began: now, drawn: stats.drawn, t };
  const parts = [`${stats.perSecond.toFixed(0)} pictures/s`];
  if (hello?.kind === "live" && clockRatio !== null && !frozen) parts.push(`${clockRatio.toFixed(2)} × real time`);
  if (lost) parts.push(`${lost} messages lost`);
  if (skipped) parts.push(`${skipped} pictures skipped`);
  at("rate").textContent = parts.join(" · ");
  if (hello?.kind === "live" && !over) {
    const silent = now - heard > SILENT_MS;
    notice(silent ? `nothing heard for ${((now - heard) / 1000).toFixed(0)} s: has the run ended?` : "");
  }
}

function say(state) {
  at("time").textContent = `${state.t.toFixed(3)} s`;
  const reach = state.reach >= 0 ? `, reach ${state.reach + 1} of ${hello.rig.reaches}`
    + (state.target > 0 ? `, clock position ${state.target}` : "") : "";
  const stretched = state.saturated ? ", desired hand out of reach" : "";
  at("where").textContent =
    `${hello.rig.mode}, repetition ${state.repetition + 1}: ${PHASES[state.phase] ?? ""}${reach}${stretched}`;
}

function frame(now) {
  requestAnimationFrame(frame);
  perSecond(now);
  now = performance.now();
  release(now);
  if (!fresh && !wish) return;
  const rig = hello?.rig;
  const state = states.at(-1);
  arm.draw(rig, states, wish);
  lens.draw(rig, states);
  for (const view of torques) view.draw(rig, states);
  nodesView.draw(nodes, state);
  canvas.classList.toggle("reachable", mayDrag());
  at("hint").hidden = !mayDrag();
  if (state && rig && now - said > SAID_EVERY_MS) {
    said = now;
    say(state);
  }
  if (fresh) stats.drawn += 1;
  stats.drawing_ms += performance.now() - now;
  fresh = false;
}
requestAnimationFrame(frame);
const redraw = () => { fresh = true; };
addEventListener("resize", redraw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
