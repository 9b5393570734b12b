// Wrench over time: values are kept here and drawn here, the server only appends.
const WINDOW_S = 30;
const CAPACITY = 900;
const REDRAW_MS = 100;
const COLOURS = ["#60a5fa", "#4ade80", "#fbbf24"];
const FONT = "11px system-ui, sans-serif";

function niceStep(range) {
  const raw = range / 5;
  const power = Math.pow(10, Math.floor(Math.log10(raw)));
  for (const factor of [1, 2, 2.5, 5, 10]) if (factor * power >= raw) return factor * power;
  return 10 * power;
}

export class Chart {
  // from: first of three components of the wrench; floor: least half range of the axis.
  constructor(canvas, { from, unit, floor }) {
    this.canvas = canvas;
    this.from = from;
    this.unit = unit;
    this.floor = floor;
    this.rows = new Float64Array(CAPACITY * 7).fill(NaN);
    this.count = 0;
    this.drawn = 0;
    this.pending = false;
  }

  add(frame) {
    const at = (this.count % CAPACITY) * 7;
    this.rows[at] = performance.now() / 1000;
    for (let i = 0; i < 3; i++) {
      this.rows[at + 1 + i] = frame.w ? frame.w[this.from + i] ?? NaN : NaN;
      this.rows[at + 4 + i] = frame.d ? frame.d[this.from + i] ?? NaN : NaN;
    }
    this.count += 1;
    const now = performance.now();
    if (!this.pending && now - this.drawn >= REDRAW_MS) {
      this.pending = true;
      requestAnimationFrame(() => this.draw());
    }
  }

  draw() {
    this.pending = false;
    this.drawn = performance.now();
    const ratio = window.devicePixelRatio || 1;
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    if (!width) return;
    if (this.canvas.width !== Math.round(width * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
    }
    const g = this.canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    const box = { left: 40, right: width - 8, top: 8, bottom: height - 20 };
    const now = this.drawn / 1000, kept = Math.min(this.count, CAPACITY);
    let most = this.floor;
    for (let k = this.count - kept; k < this.count; k++) {
      const at = (k % CAPACITY) * 7;
      if (now - this.rows[at] > WINDOW_S) continue;
      for (let i = 1; i < 7; i++) {
        const size = Math.abs(this.rows[at + i]);
        if (size > most) most = size;
      }
    }
    const step = niceStep(2 * most), top = Math.ceil(most / step) * step;
    const x = (t) => box.right - ((now - t) / WINDOW_S) * (box.right - box.left);
    const y = (v) => (box.top + box.bottom) / 2 - (v / top) * (box.bottom - box.top) / 2;
    this.axes(g, box, top, step, x, y, now);
    g.save();
    g.beginPath();
    g.rect(box.left, box.top - 2, box.right - box.left, box.bottom - box.top + 4);
    g.clip();
    for (let i = 0; i < 3; i++) {
      this.line(g, 4 + i, COLOURS[i], [5, 4], 1.2, x, y, kept);
      this.line(g, 1 + i, COLOURS[i], [], 1.8, x, y, kept);
    }
    g.restore();
  }

  axes(g, box, top, step, x, y, now) {
    g.font = FONT;
    g.fillStyle = "#9fb0bf";
    g.lineWidth = 1;
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (let v = -top; v <= top + 1e-9; v += step) {
      g.strokeStyle = Math.abs(v) < 1e-9 ? "#52616f" : "#252f39";
      g.beginPath();
      g.moveTo(box.left, y(v));
      g.lineTo(box.right, y(v));
      g.stroke();
      g.fillText(String(+v.toPrecision(3)), box.left - 6, y(v));
    }
    g.textBaseline = "top";
    for (let s = 0; s <= WINDOW_S; s += 10) {
      g.textAlign = s === 0 ? "right" : s === WINDOW_S ? "left" : "center";
      g.fillText(s === 0 ? "now" : `-${s} s`, x(now - s), box.bottom + 5);
    }
  }

  line(g, column, colour, dash, width, x, y, kept) {
    g.strokeStyle = colour;
    g.lineWidth = width;
    g.setLineDash(dash);
    g.beginPath();
    let drawing = false;
    for (let k = this.count - kept; k < this.count; k++) {
      const at = (k % CAPACITY) * 7, value = this.rows[at + column];
      if (Number.isNaN(value)) { drawing = false; continue; }
      if (drawing) g.lineTo(x(this.rows[at]), y(value));
      else g.moveTo(x(this.rows[at]), y(value));
      drawing = true;
    }
    g.stroke();
    g.setLineDash([]);
  }
}
