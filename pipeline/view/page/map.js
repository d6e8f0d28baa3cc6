// The map: a canvas with its own view, in Web Mercator units (0 to 1 over the world).
import { drawAdding, drawSigns } from "./marks.js";
import { metresPerUnit, place } from "./signs.js";

const MAX_PX_PER_M = 400;

export class SignMap {
  constructor(canvas, state) {
    this.canvas = canvas;
    this.state = state;
    this.ctx = canvas.getContext("2d");
    this.x = 0.5; this.y = 0.5; this.k = 256;
    this.drawn = [];
    this.onPick = () => {};
    this.onMove = () => {};
    this.onPlace = () => {};
    this.below = null;
    this.pointers = new Map();
    new ResizeObserver(() => this.resize()).observe(canvas);
    canvas.addEventListener("wheel", (e) => this.wheel(e), { passive: false });
    canvas.addEventListener("pointerdown", (e) => this.down(e));
    canvas.addEventListener("pointermove", (e) => this.moved(e));
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => this.up(e));
    canvas.addEventListener("dblclick", (e) => this.zoomBy(2, e.offsetX, e.offsetY));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.colours = null; this.redraw(); });
    this.resize();
  }

  resize() {
    const ratio = devicePixelRatio || 1;
    this.w = this.canvas.clientWidth; this.h = this.canvas.clientHeight;
    this.canvas.width = Math.max(1, Math.round(this.w * ratio));
    this.canvas.height = Math.max(1, Math.round(this.h * ratio));
    this.ratio = ratio;
    this.redraw();
  }

  // screen <-> world
  sx(x) { return (x - this.x) * this.k + this.w / 2; }
  sy(y) { return (y - this.y) * this.k + this.h / 2; }
  wx(sx) { return (sx - this.w / 2) / this.k + this.x; }
  wy(sy) { return (sy - this.h / 2) / this.k + this.y; }
  get pxPerM() { return this.k / metresPerUnit(this.y); }

  clampScale(k) {
    return Math.min(Math.max(k, Math.max(64, this.h / 2)), MAX_PX_PER_M * metresPerUnit(this.y));
  }

  zoomBy(factor, sx = this.w / 2, sy = this.h / 2) {
    this.touched = true;
    const k = this.clampScale(this.k * factor);
    const x = this.wx(sx), y = this.wy(sy);
    this.k = k;
    this.x = x - (sx - this.w / 2) / k;
    this.y = y - (sy - this.h / 2) / k;
    this.redraw();
  }

  panBy(dx, dy) {
    this.touched = true;
    this.x += dx / this.k; this.y += dy / this.k;
    this.redraw();
  }

  centre(x, y, pxPerM = 0) {
    if (!Number.isFinite(x)) return;
    this.x = x; this.y = y;
    if (pxPerM) this.k = this.clampScale(Math.max(this.k, pxPerM * metresPerUnit(y)));
    this.redraw();
  }

  fit([x0, y0, x1, y1], padding = 0.12, maxPxPerM = 12) {
    if (!Number.isFinite(x0)) return;
    this.x = (x0 + x1) / 2; this.y = (y0 + y1) / 2;
    const room = 1 - padding;
    const k = Math.min(this.w * room / Math.max(x1 - x0, 1e-12), this.h * room / Math.max(y1 - y0, 1e-12));
    this.k = this.clampScale(Math.min(k, maxPxPerM * metresPerUnit(this.y)));
    this.redraw();
  }

  wheel(e) {
    e.preventDefault();
    const step = e.deltaMode === 1 ? e.deltaY * 16 : e.deltaY;
    this.zoomBy(Math.exp(-step * (e.ctrlKey ? 0.01 : 0.0018)), e.offsetX, e.offsetY);
  }

  down(e) {
    this.canvas.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, [e.offsetX, e.offsetY]);
    this.travel = 0;
    const hit = this.hit(e.offsetX, e.offsetY);
    const held = this.state.moving || this.state.turning !== null;
    // what is turned is held by its arrow too
    const own = hit && hit.row === this.state.selected;
    this.dragged = held && (own || this.nearArrow(e.offsetX, e.offsetY)) ? this.state.selected : null;
    this.canvas.classList.add("drag");
  }

  moved(e) {
    const before = this.pointers.get(e.pointerId);
    if (!before) return;
    const now = [e.offsetX, e.offsetY];
    if (this.pointers.size === 2) {
      const [other] = [...this.pointers].filter(([id]) => id !== e.pointerId).map(([, p]) => p);
      const far = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      this.zoomBy(far(now) / Math.max(far(before), 1), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      this.travel = 99;
    } else {
      this.travel += Math.hypot(now[0] - before[0], now[1] - before[1]);
      if (this.travel > 3 || this.dragged !== null) {
        if (this.dragged !== null) this.onMove((now[0] - before[0]) / this.k, (now[1] - before[1]) / this.k, this.wx(now[0]), this.wy(now[1]));
        else this.panBy(before[0] - now[0], before[1] - now[1]);
      }
    }
    this.pointers.set(e.pointerId, now);
  }

  up(e) {
    if (!this.pointers.delete(e.pointerId)) return;
    if (!this.pointers.size) this.canvas.classList.remove("drag");
    if (e.type === "pointerup" && this.travel <= 3 && this.dragged === null) this.click(e.offsetX, e.offsetY);
    this.dragged = null;
  }

  nearArrow(sx, sy) {
    if (this.state.turning === null) return false;
    const [x, y] = place(this.state.signs, this.state.selected);
    return Math.hypot(this.sx(x) - sx, this.sy(y) - sy) < 60;
  }

  hit(sx, sy) {
    // where things are now, not where they were drawn last
    if (this.pending) this.draw();
    let best = null, least = Infinity;
    for (const item of this.drawn) {
      const far = Math.hypot(item.sx - sx, item.sy - sy);
      if (far < item.r + 4 && far - (item.row === this.state.selected ? 4 : 0) < least) { best = item; least = far; }
    }
    return best;
  }

  click(sx, sy) {
    if (this.state.adding) return this.onPlace(this.wx(sx), this.wy(sy));
    const hit = this.hit(sx, sy);
    if (!hit) return;
    if (hit.row !== undefined) this.onPick(hit.row);
    // signs on one pole stay together until the map no longer puts them together
    else this.fit(hit.box, 0.3, 40);
  }

  redraw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => { this.pending = false; this.draw(); });
  }

  colour(name) {
    if (!this.colours) {
      const style = getComputedStyle(document.documentElement);
      this.colours = new Proxy({}, { get: (memo, key) => (memo[key] ??= style.getPropertyValue(key).trim()) });
    }
    return this.colours[name];
  }

  draw() {
    const { ctx } = this;
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    ctx.clearRect(0, 0, this.w, this.h);
    if (!this.below?.draw(ctx)) this.drawGrid();
    for (const path of this.state.paths.values()) this.drawPath(path);
    this.drawn = drawSigns(this, this.state);
    drawAdding(this, this.state);
    this.drawVehicle();
    this.drawScale();
    this.state.frames = (this.state.frames || 0) + 1;
  }

  drawGrid() {
    const { ctx } = this;
    const step = this.niceMetres(130) / metresPerUnit(this.y);
    ctx.strokeStyle = this.colour("--map-grid");
    ctx.lineWidth = 1;
    ctx.beginPath();
    for (let x = Math.ceil(this.wx(0) / step) * step; x < this.wx(this.w); x += step) { ctx.moveTo(this.sx(x), 0); ctx.lineTo(this.sx(x), this.h); }
    for (let y = Math.ceil(this.wy(0) / step) * step; y < this.wy(this.h); y += step) { ctx.moveTo(0, this.sy(y)); ctx.lineTo(this.w, this.sy(y)); }
    ctx.stroke();
  }

  // a round length in metres of about this many pixels
  niceMetres(px) {
    const wanted = px / this.pxPerM;
    const power = 10 ** Math.floor(Math.log10(wanted));
    return [5, 2, 1].map((m) => m * power).find((m) => m <= wanted);
  }

  drawPath(path) {
    const { ctx } = this;
    ctx.lineJoin = ctx.lineCap = "round";
    // on a picture from the air the path has a rim
    for (const rim of this.below?.on ? [true, false] : [false]) for (const run of path.runs) {
      ctx.lineWidth = rim ? 6 : 3;
      ctx.strokeStyle = rim ? this.colour("--card") : run.colour;
      ctx.beginPath();
      let px = Infinity, py = Infinity;
      for (let i = run.from; i <= run.to; i++) {
        const sx = this.sx(path.x[i]), sy = this.sy(path.y[i]);
        // what is nearer than a pixel to the last point adds nothing
        if (i === run.from) ctx.moveTo(sx, sy);
        else if (Math.abs(sx - px) + Math.abs(sy - py) > 1 || i === run.to) ctx.lineTo(sx, sy);
        else continue;
        px = sx; py = sy;
      }
      ctx.stroke();
    }
  }

  drawVehicle() {
    const at = this.state.vehicle;
    if (!at) return;
    const { ctx } = this;
    ctx.save();
    ctx.translate(this.sx(at.x), this.sy(at.y));
    ctx.rotate((at.yaw_deg ?? 0) * Math.PI / 180);
    ctx.beginPath();
    ctx.moveTo(0, -13); ctx.lineTo(8, 10); ctx.lineTo(0, 5); ctx.lineTo(-8, 10); ctx.closePath();
    ctx.fillStyle = this.colour("--accent"); ctx.fill();
    ctx.lineWidth = 2; ctx.strokeStyle = this.colour("--card"); ctx.stroke();
    ctx.restore();
  }

  drawScale() {
    const metres = this.niceMetres(120);
    const box = document.getElementById("scale");
    box.firstElementChild.style.width = `${metres * this.pxPerM}px`;
    box.lastElementChild.textContent = metres >= 1000 ? `${metres / 1000} km` : metres >= 1 ? `${metres} m` : `${Math.round(metres * 100)} cm`;
  }
}
