// One joint's torque over the last seconds, between plus and minus T_max, beside T_d.

import { begin, colour, faded, line } from "./canvas.js";

const WINDOW_S = 3;
const SAID_EVERY_MS = 100;
const STEPS_NM = [0.1, 0.2, 0.3, 0.5, 1, 1.5, 2, 3, 5, 7.5, 10, 15, 20, 30, 50];
const LEFT = 38;
const BOTTOM = 16;

export class TorqueView {
  constructor(box, joint) {
    this.canvas = box.querySelector("canvas");
    this.joint = joint;
    this.said = 0;
    this.numbers = [["τ", ""], ["T", "d"], ["T", "max"], ["limit", ""]].map(([name, index]) => {
      const entry = document.createElement("span");
      const low = document.createElement("sub");
      low.textContent = index;
      const number = document.createElement("b");
      entry.append(name, low, " ", number);
      box.querySelector(".values").append(entry);
      return number;
    });
  }

  draw(rig, states) {
    const { g, width, height } = begin(this.canvas);
    const state = states.at(-1);
    if (!rig || !state?.tau) return;
    const joint = this.joint;
    const limit = rig.torque_limit_Nm[joint];
    const shown = states.filter((s) => s.t > state.t - WINDOW_S && s.tau && s.tau_max && s.tau_d);
    const largest = Math.max(...shown.map((s) =>
      Math.max(Math.abs(s.tau[joint]), Math.abs(s.tau_d[joint]), Math.min(s.tau_max[joint], limit))));
    const top = STEPS_NM.find((step) => step >= 1.05 * largest) ?? 1.1 * limit;
    const right = width - 4;
    const middle = (height - BOTTOM) / 2;
    const x = (t) => right - ((state.t - t) / WINDOW_S) * (right - LEFT);
    const y = (torque) => middle - (Math.max(-1, Math.min(1, torque / top))) * (middle - 3);
    this.axes(g, top, x, y, right, height, state.t);

    // T_max as a band about zero.
    g.fillStyle = faded("link", 0.2);
    g.beginPath();
    shown.forEach((s, i) => (i ? g.lineTo : g.moveTo).call(g, x(s.t), y(s.tau_max[joint])));
    for (const s of shown.toReversed()) g.lineTo(x(s.t), y(-s.tau_max[joint]));
    g.fill();
    line(g, shown.map((s) => [x(s.t), y(s.tau_d[joint])]), faded("ink", 0.8), 1.3, [5, 4]);
    this.torque(g, shown, x, y, joint);
    this.say(state, joint, limit);
  }

  // In the colour of the phase, piece by piece.
  torque(g, shown, x, y, joint) {
    let piece = [];
    shown.forEach((s, i) => {
      piece.push([x(s.t), y(s.tau[joint])]);
      const next = shown[i + 1];
      if (!next || next.convergence[joint] !== s.convergence[joint]) {
        if (next) piece.push([x(next.t), y(next.tau[joint])]);
        line(g, piece, colour(s.convergence[joint] ? "convergence" : "divergence"), 2);
        piece = [];
      }
    });
  }

  axes(g, top, x, y, right, height, now) {
    g.fillStyle = colour("faint");
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (const value of [top, 0, -top]) {
      line(g, [[LEFT, y(value)], [right, y(value)]], colour(value ? "grid" : "rule"), 1);
    }
    g.fillText(`${top}`, LEFT - 5, y(top) + 4);
    g.fillText("0 N m", LEFT - 2, y(0));
    g.fillText(`−${top}`, LEFT - 5, y(-top) - 4);
    g.textBaseline = "alphabetic";
    g.textAlign = "center";
    for (let t = Math.ceil(now - WINDOW_S); t <= now; t++) {
      line(g, [[x(t), y(top)], [x(t), y(-top)]], colour("grid"), 1);
      if (x(t) > LEFT + 14 && x(t) < right - 14) g.fillText(`${t} s`, x(t), height - 3);
    }
  }

  // Numbers that change faster cannot be read.
  say(state, joint, limit) {
    if (performance.now() - this.said < SAID_EVERY_MS) return;
    this.said = performance.now();
    const number = (value) => value.toFixed(2).replace("-", "−");
    const texts = [state.tau[joint], state.tau_d[joint], state.tau_max[joint]].map(number);
    [...texts, `${limit} N m`].forEach((text, i) => { this.numbers[i].textContent = text; });
  }
}
