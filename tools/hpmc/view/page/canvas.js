// Drawing helpers: sharp canvases, colours of the style sheet, rules and arrows.

const probe = getComputedStyle(document.documentElement);
const cache = new Map();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => cache.clear());

export function colour(name) {
  if (!cache.has(name)) cache.set(name, probe.getPropertyValue(`--${name}`).trim());
  return cache.get(name);
}

export const FONT = '12px system-ui, "Segoe UI", "Liberation Sans", "DejaVu Sans", sans-serif';

// A cleared context in CSS pixels, as large as the canvas is shown.
export function begin(canvas, width = canvas.clientWidth, height = canvas.clientHeight) {
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, width, height);
  g.font = FONT;
  g.lineJoin = g.lineCap = "round";
  return { g, width, height };
}

export function line(g, points, style, width, dash = []) {
  if (points.length < 2) return;
  g.strokeStyle = style;
  g.lineWidth = width;
  g.setLineDash(dash);
  g.beginPath();
  points.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y)));
  g.stroke();
  g.setLineDash([]);
}

export function disc(g, [x, y], radius, fill, stroke, width = 1) {
  g.beginPath();
  g.arc(x, y, radius, 0, 2 * Math.PI);
  if (fill) { g.fillStyle = fill; g.fill(); }
  if (stroke) { g.strokeStyle = stroke; g.lineWidth = width; g.stroke(); }
}

export function arrow(g, [x, y], [dx, dy], style, width) {
  const length = Math.hypot(dx, dy);
  if (length < 1) return;
  const head = Math.min(9, length * 0.6);
  const [ux, uy] = [dx / length, dy / length];
  line(g, [[x, y], [x + dx - ux * head * 0.7, y + dy - uy * head * 0.7]], style, width);
  g.fillStyle = style;
  g.beginPath();
  g.moveTo(x + dx, y + dy);
  g.lineTo(x + dx - ux * head - uy * head * 0.45, y + dy - uy * head + ux * head * 0.45);
  g.lineTo(x + dx - ux * head + uy * head * 0.45, y + dy - uy * head - ux * head * 0.45);
  g.fill();
}

export function faded(name, share) {
  // Colours of the style sheet are #rrggbb.
  return colour(name) + Math.round(share * 255).toString(16).padStart(2, "0");
}
