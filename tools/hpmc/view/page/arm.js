// The arm in the plane, seen from above; m, x to the right, y up, shoulder at the origin.

import { arrow, begin, colour, disc, faded, line } from "./canvas.js";

const TRACE_S = 4;
const N_PER_M = 400; // link forces: 400 N are drawn as long as 1 m of the plane
const VIEW_M = { left: -0.1, right: 0.63, bottom: -0.36, top: 0.36 };
const HAND = 2;

export class ArmView {
  constructor(canvas) {
    this.canvas = canvas;
    this.backdrop = document.createElement("canvas"); // what does not move
    this.backdropKey = "";
  }

  // Maps between the plane and the canvas, with the same scale both ways.
  layout(width, height) {
    const scale = Math.min(
      width / (VIEW_M.right - VIEW_M.left),
      height / (VIEW_M.top - VIEW_M.bottom),
    );
    const x0 = width / 2 - (scale * (VIEW_M.left + VIEW_M.right)) / 2;
    const y0 = height / 2 + (scale * (VIEW_M.bottom + VIEW_M.top)) / 2;
    this.scale = scale;
    this.place = ([x, y]) => [x0 + scale * x, y0 - scale * y];
    this.inverse = (x, y) => [(x - x0) / scale, (y0 - y) / scale];
  }

  // Point of the plane under a pointer event.
  pointOf(event) {
    const box = this.canvas.getBoundingClientRect();
    return this.inverse(event.clientX - box.left, event.clientY - box.top);
  }

  draw(rig, states, wish) {
    const { g, width, height } = begin(this.canvas);
    this.layout(width, height);
    this.still(rig, width, height);
    g.drawImage(this.backdrop, 0, 0, width, height);
    if (!rig) return;
    const state = states.at(-1);
    if (!state?.links) return;
    const running = state.phase >= 3 && state.phase <= 4;
    const past = states.filter((s) => s.t > state.t - TRACE_S && s.links);
    if (running) {
      this.regions(g, rig, state);
      this.trace(g, past.filter((s) => s.phase >= 3).map((s) => s.x_d), "desired", 3, [6, 5]);
    }
    this.links(g, state);
    this.trace(g, past.filter((s) => s.phase >= 2).map((s) => s.links[HAND]), "measured", 1.5, []);
    if (running) {
      this.forces(g, state);
      this.band(g, state);
    }
    if (wish) disc(g, this.place(wish), 12, null, faded("target", 0.6), 1.5);
  }

  still(rig, width, height) {
    const key = [this.canvas.width, this.canvas.height, colour("ink"), JSON.stringify(rig)].join();
    if (key === this.backdropKey) return;
    this.backdropKey = key;
    const { g } = begin(this.backdrop, width, height);
    this.grid(g, width, height);
    if (rig) {
      this.ring(g, rig);
      if (rig.clock) this.targets(g, rig);
    }
    this.scales(g, height);
  }

  grid(g, width, height) {
    g.fillStyle = colour("faint");
    g.textBaseline = "alphabetic";
    const [xMin, yMax] = this.inverse(0, 0);
    const [xMax, yMin] = this.inverse(width, height);
    for (let i = Math.ceil(xMin * 10); i <= xMax * 10; i++) {
      const [x] = this.place([i / 10, 0]);
      line(g, [[x, 0], [x, height]], colour(i ? "grid" : "rule"), 1);
      g.textAlign = "center";
      if (x > 24 && x < width - 24 && i % 2 === 0) g.fillText((i / 10).toFixed(1), x, height - 6);
    }
    for (let i = Math.ceil(yMin * 10); i <= yMax * 10; i++) {
      const [, y] = this.place([0, i / 10]);
      line(g, [[0, y], [width, y]], colour(i ? "grid" : "rule"), 1);
      g.textAlign = "left";
      if (y > 24 && y < height - 24 && i % 2 === 0) g.fillText((i / 10).toFixed(1), 6, y - 3);
    }
    g.textAlign = "right";
    g.fillText("x, m", width - 6, height - 6);
    g.textAlign = "left";
    g.fillText("y, m", 6, 16);
  }

  // Where the hand can be put with the orientation of the task: the wrist reaches a ring.
  ring(g, rig) {
    const [arm, forearm, hand] = rig.length_m;
    const centre = this.place([hand * Math.cos(rig.w_t_rad), hand * Math.sin(rig.w_t_rad)]);
    g.setLineDash([2, 6]);
    disc(g, centre, this.scale * (arm + forearm), null, colour("faint"));
    g.setLineDash([]);
  }

  targets(g, rig) {
    for (let i = 0; i <= 8; i++) {
      const angle = ((i - 1) * Math.PI) / 4;
      const r = i ? rig.radius_m : 0;
      const at = [rig.centre_m[0] + r * Math.cos(angle), rig.centre_m[1] + r * Math.sin(angle)];
      disc(g, this.place(at), 4, null, faded("target", 0.55));
    }
  }

  regions(g, rig, state) {
    for (const at of state.links_d) {
      disc(g, this.place(at), rig.region_m * this.scale, faded("region", 0.22), faded("region", 0.8));
    }
  }

  trace(g, points, name, width, dash) {
    line(g, points.map(this.place), faded(name, 0.85), width, dash);
  }

  links(g, state) {
    const points = [[0, 0], ...state.links].map(this.place);
    [13, 10, 7].forEach((thick, i) => {
      line(g, [points[i], points[i + 1]], faded("link", 0.55), thick);
    });
    // Joint i turns at point i. Convergence is a square too, for those who see no colours.
    points.slice(0, 3).forEach((at, i) => {
      if (state.convergence[i]) {
        g.fillStyle = colour("convergence");
        g.fillRect(at[0] - 7, at[1] - 7, 14, 14);
      } else {
        disc(g, at, 8, colour("divergence"));
      }
      g.fillStyle = colour("card");
      g.textAlign = "center";
      g.textBaseline = "middle";
      g.fillText(String(i + 1), at[0], at[1] + 0.5);
      g.textBaseline = "alphabetic";
    });
    disc(g, points[3], 4, colour("measured"));
  }

  forces(g, state) {
    state.forces.forEach((force, i) => {
      const arrowOf = force.map((f) => (f / N_PER_M) * this.scale);
      arrow(g, this.place(state.links[i]), [arrowOf[0], -arrowOf[1]], colour("force"), 2.5);
    });
  }

  band(g, state) {
    const [target, desired] = [this.place(state.x_t), this.place(state.x_d)];
    line(g, [desired, target], colour("target"), 3, [1, 6]);
    const [x, y] = target;
    disc(g, target, 9, faded("target", 0.2), colour("target"), 2);
    line(g, [[x - 5, y], [x + 5, y]], colour("target"), 2);
    line(g, [[x, y - 5], [x, y + 5]], colour("target"), 2);
    disc(g, desired, 4, colour("desired"), colour("card"));
  }

  scales(g, height) {
    const length = (40 / N_PER_M) * this.scale;
    arrow(g, [46, height - 26], [length, 0], colour("force"), 2.5);
    g.fillStyle = colour("faint");
    g.textAlign = "left";
    g.fillText("40 N", 52 + length, height - 22);
  }
}

// The hand magnified, centred on where it is desired: the tracking error, which the plane hides.
export class LensView {
  constructor(canvas) {
    this.canvas = canvas;
  }

  draw(rig, states) {
    const { g, width, height } = begin(this.canvas);
    const state = states.at(-1);
    if (!rig || !state?.links || state.phase < 3 || state.phase > 4) return;
    const radius = width / 2 - 2;
    const centre = [width / 2, radius + 2];
    const error = (s) => [s.links[HAND][0] - s.links_d[HAND][0], s.links[HAND][1] - s.links_d[HAND][1]];
    const now = error(state);
    const size = Math.hypot(...now);
    // The smallest of these that shows it; the lens does not breathe with every sample.
    const half = [0.002, 0.005, 0.01, 0.02, 0.05, 0.1].find((m) => m > 1.2 * size) ?? 0.2;
    const place = ([x, y]) => [centre[0] + (x / half) * radius, centre[1] - (y / half) * radius];
    g.save();
    disc(g, centre, radius, colour("card"), colour("rule"), 1.5);
    g.clip();
    line(g, [[0, centre[1]], [width, centre[1]]], colour("grid"), 1);
    line(g, [[centre[0], 0], [centre[0], height]], colour("grid"), 1);
    const past = states.filter((s) => s.t > state.t - 1 && s.links && s.phase >= 3);
    line(g, past.map((s) => place(error(s))), faded("measured", 0.6), 1.2);
    disc(g, centre, 4, colour("desired"));
    disc(g, place(now), 4, colour("measured"), colour("card"));
    g.restore();
    g.fillStyle = colour("faint");
    g.textAlign = "center";
    g.fillText(`X off X_d: ${(1000 * size).toFixed(1)} mm`, centre[0], height - 18);
    g.fillText(`radius ${1000 * half} mm`, centre[0], height - 4);
  }
}
