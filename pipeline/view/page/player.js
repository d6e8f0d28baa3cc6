// Time: the slider, the vehicle on the map, the frame of the video with its boxes.
import * as api from "./api.js";
import { words } from "./signs.js";

export class Player {
  constructor(app) {
    this.app = app;
    this.drive = null; this.camera = null; this.t = 0; this.frame = -1;
    const { byId } = app;
    this.slider = byId("time");
    this.canvas = byId("frame");
    this.slider.oninput = () => this.seek(Number(this.slider.value));
    byId("play").onclick = () => this.toggle();
    byId("back").onclick = () => this.step(-1);
    byId("forward").onclick = () => this.step(1);
    byId("drive").onchange = (e) => this.show(Number(e.target.value));
    byId("camera").onchange = (e) => { this.camera = this.drive.cameras[Number(e.target.value)]; this.frame = -1; this.seek(this.t); };
    app.overview.drives.forEach((name, k) => byId("drive").append(new Option(name, k)));
    this.canvas.addEventListener("click", (e) => this.click(e));
    this.point = null;
    new ResizeObserver(() => this.marks()).observe(byId("marks"));
  }

  // a drive's path and cameras, fetched once
  load(k) {
    const { drives } = this.app.state;
    if (!drives.has(k)) {
      drives.set(k, api.json(`api/drive/${k}`).then((drive) => {
        this.app.addPath(k, drive.path);
        return { ...drive, number: k };
      }, (error) => { this.app.hint(error.message); return null; }));
    }
    return drives.get(k);
  }

  async show(k) {
    const drive = await this.load(k);
    if (!drive || this.drive === drive) return;
    this.drive = drive;
    this.app.byId("drive").value = String(k);
    const box = this.app.byId("camera");
    box.replaceChildren(...drive.cameras.map((camera, i) => new Option(camera.name, i)));
    this.camera = drive.cameras[0] ?? null;
    this.frame = -1;
    const ends = [drive.path?.t.at(-1), ...drive.cameras.map((camera) => camera.t.at(-1))].filter((v) => v !== undefined);
    const starts = [drive.path?.t[0], ...drive.cameras.map((camera) => camera.t[0])].filter((v) => v !== undefined);
    this.slider.min = String(Math.min(...starts, 0));
    this.slider.max = String(Math.max(...ends, 0));
    this.marks();
    await this.seek(Number(this.slider.min));
  }

  async showFrame(k, cameraName, frame, t) {
    await this.show(k);
    if (!this.drive) return;
    const index = this.drive.cameras.findIndex((camera) => camera.name === cameraName);
    if (index >= 0) { this.camera = this.drive.cameras[index]; this.app.byId("camera").value = String(index); }
    const at = this.camera ? search(this.camera.frame, frame) : -1;
    await this.seek(at >= 0 && this.camera.frame[at] === frame ? this.camera.t[at] : t);
  }

  seek(t) {
    this.t = t;
    this.slider.value = String(t);
    this.vehicle();
    this.clock();
    return this.request();
  }

  vehicle() {
    const path = this.drive?.path;
    if (!path) { this.app.state.vehicle = null; return this.app.map.redraw(); }
    const i = Math.min(Math.max(search(path.t, this.t), 0), path.t.length - 2);
    const share = Math.min(Math.max((this.t - path.t[i]) / (path.t[i + 1] - path.t[i] || 1), 0), 1);
    const mix = (a) => a[i] + share * (a[i + 1] - a[i]);
    const turn = path.yaw_deg[i] === null ? null : path.yaw_deg[i] + share * ((((path.yaw_deg[i + 1] - path.yaw_deg[i]) % 360) + 540) % 360 - 180);
    this.app.state.vehicle = { x: mix(path.x), y: mix(path.y), yaw_deg: turn };
    this.app.map.redraw();
  }

  clock() {
    const { start_utc: utc } = this.drive;
    const text = utc ? new Date(Date.parse(utc) + this.t * 1000).toISOString().replace("T", " ").slice(0, 21) : `${this.t.toFixed(1)} s`;
    this.app.byId("clock").textContent = text;
    this.slider.setAttribute("aria-valuetext", text);
  }

  // the newest wish alone is fetched, once the request under way is done
  async request() {
    if (!this.camera?.frame.length) { this.note("This drive has no camera."); this.blank(); return; }
    const at = Math.max(nearest(this.camera.t, this.t), 0);
    this.wish = { drive: this.drive, camera: this.camera, frame: this.camera.frame[at], t: this.camera.t[at] };
    if (this.busy) return this.busy;
    this.busy = (async () => {
      while (this.wish) {
        const wish = this.wish;
        this.wish = null;
        if (wish.frame !== this.frame || wish.camera !== this.shownCamera) await this.fetch(wish);
        else this.paint();
      }
    })().finally(() => { this.busy = null; });
    return this.busy;
  }

  async fetch(wish) {
    const where = `${wish.drive.number}/${wish.frame}/${encodeURIComponent(wish.camera.name)}`;
    const [picture, boxes] = await Promise.all([
      wish.camera.video ? api.picture(`frame/${where}`).catch(() => null) : null,
      api.json(`api/boxes/${where}`).catch(() => []),
    ]);
    this.frame = wish.frame; this.shownCamera = wish.camera;
    this.shown = { ...wish, picture, boxes };
    this.paint();
    const missing = !wish.camera.video ? "no video, boxes alone" : picture ? "" : "this frame cannot be decoded";
    this.note([`frame ${wish.frame}`, boxes.length ? `${boxes.length} box${boxes.length > 1 ? "es" : ""}` : "", missing].filter(Boolean).join(", "));
  }

  note(text) { this.app.byId("video-note").textContent = text; }

  blank() { this.canvas.width = 640; this.canvas.height = 120; }

  paint() {
    if (!this.shown) return;
    const { camera, picture, boxes } = this.shown;
    const width = picture?.width ?? Math.min(camera.width, 1280);
    const scale = width / camera.width;
    this.canvas.width = width;
    this.canvas.height = picture?.height ?? Math.round(camera.height * scale);
    const ctx = this.canvas.getContext("2d");
    if (picture) ctx.drawImage(picture, 0, 0);
    const { selected } = this.app.state;
    const chosen = selected === null ? null : this.app.card?.sign ?? null;
    const line = Math.max(1.5, width / 500);
    // to be read in the panel, which is narrower than the frame
    const high = Math.round(Math.max(width / 60, 11 * width / (this.canvas.clientWidth || width)));
    ctx.font = `600 ${high}px system-ui, sans-serif`;
    ctx.textBaseline = "bottom";
    const taken = [];
    const isOwn = (box) => chosen !== null && this.app.card.boxes.has(`${this.drive.number}/${box.row}`);
    const rank = (box) => (isOwn(box) ? Infinity : box.box[3] - box.box[1]);
    // the chosen one first, then the near ones: labels that would lie on those are left out
    for (const box of [...boxes].sort((a, b) => rank(b) - rank(a))) {
      const [x0, y0, x1, y1] = box.box.map((v) => v * scale);
      const own = isOwn(box);
      if (own && picture) this.app.card.closeUp(picture, [x0, y0, x1, y1], this.frame);
      ctx.strokeStyle = own ? "#ffd33d" : box.sign ? "#58d68d" : "#9aa5b1";
      ctx.lineWidth = own ? 2 * line : line;
      ctx.strokeRect(x0, y0, x1 - x0, y1 - y0);
      const label = `${words(box.class)} ${box.score.toFixed(2)}`;
      const wide = ctx.measureText(label).width;
      const x = Math.min(x0, Math.max(0, width - wide - 6)), y = y0 > 1.3 * high ? y0 - 2 : y1 + 1.2 * high;
      const place = [x, y - 1.1 * high, x + wide + 6, y + 0.1 * high];
      if (taken.some((t) => place[0] < t[2] && t[0] < place[2] && place[1] < t[3] && t[1] < place[3])) continue;
      taken.push(place);
      ctx.fillStyle = "rgba(11, 13, 16, 0.72)";
      ctx.fillRect(place[0], place[1], wide + 6, 1.2 * high);
      ctx.fillStyle = ctx.strokeStyle;
      ctx.fillText(label, x + 3, y);
    }
    this.crosses(ctx, scale, width);
  }

  // where a sign was clicked, pixels of the whole frame
  crosses(ctx, scale, width) {
    const { adding } = this.app.state;
    const { drive, camera, frame } = this.shown;
    const same = (c) => c.drive === drive.number && c.camera === camera.name && c.frame === frame;
    const clicks = adding ? adding.clicks.filter(same).map((c) => [c.x, c.y, "#ff5cc8"]) : [];
    const sign = this.app.state.selected === null ? null : this.app.card?.sign;
    for (const v of sign?.views ?? []) if (v.at && v.drive === drive.number && v.camera === camera.name && v.frame === frame) clicks.push([...v.at, "#ffd33d"]);
    if (adding && this.point && document.activeElement === this.canvas) clicks.push([...this.point, "#ffffff"]);
    const arm = width / 40;
    for (const [x, y, colour] of clicks) {
      for (const [stroke, wide] of [["#0b0d10", 5], [colour, 2.5]]) {
        ctx.strokeStyle = stroke; ctx.lineWidth = wide * width / 900;
        ctx.beginPath();
        ctx.moveTo(x * scale - arm, y * scale); ctx.lineTo(x * scale + arm, y * scale);
        ctx.moveTo(x * scale, y * scale - arm); ctx.lineTo(x * scale, y * scale + arm);
        ctx.stroke();
      }
    }
  }

  click(e) {
    if (!this.app.state.adding || !this.shown) return;
    const box = this.canvas.getBoundingClientRect();
    this.mark((e.clientX - box.left) / box.width * this.shown.camera.width, (e.clientY - box.top) / box.height * this.shown.camera.height);
  }

  mark(x, y) {
    const { drive, camera, frame } = this.shown;
    this.app.review.clickFrame({ drive: drive.number, camera: camera.name, frame, x: Math.round(x * 10) / 10, y: Math.round(y * 10) / 10 });
  }

  // the place in the frame by keyboard; true for a key that was used
  pointKey(e) {
    if (!this.shown) return false;
    const { width, height } = this.shown.camera;
    this.point ??= [width / 2, height / 2];
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
    if (e.key === "Enter") this.mark(...this.point);
    else if (step) {
      const far = e.shiftKey ? 1 : 10;
      this.point = [Math.min(Math.max(this.point[0] + far * step[0], 0), width), Math.min(Math.max(this.point[1] + far * step[1], 0), height)];
    } else return false;
    this.paint();
    return true;
  }

  // ticks where the chosen sign is seen
  marks() {
    const canvas = this.app.byId("marks");
    const ratio = devicePixelRatio || 1;
    canvas.width = Math.max(1, canvas.clientWidth * ratio);
    canvas.height = Math.max(1, canvas.clientHeight * ratio);
    const views = this.app.card?.sign?.views ?? [];
    const low = Number(this.slider.min), high = Number(this.slider.max);
    const ctx = canvas.getContext("2d");
    ctx.fillStyle = "#d4a72c";
    for (const v of views) {
      if (v.drive !== this.drive?.number || !(high > low)) continue;
      ctx.fillRect((v.t - low) / (high - low) * canvas.width - ratio, 0, 2 * ratio, canvas.height);
    }
  }

  step(n) {
    this.pause();
    if (!this.drive) return;
    const times = this.camera?.t.length ? this.camera.t : this.drive.path?.t ?? [];
    if (!times.length) return;
    const i = Math.min(Math.max(nearest(times, this.t) + n, 0), times.length - 1);
    this.seek(times[i]);
  }

  toggle() {
    if (this.playing) return this.pause();
    if (!this.drive) return;
    this.playing = true;
    this.app.byId("play").textContent = "❚❚";
    let before = performance.now();
    const tick = async (now) => {
      if (!this.playing) return;
      // a slow decoder slows the playing down rather than skipping pictures by the dozen
      const passed = Math.min((now - before) / 1000, 0.25);
      before = now;
      const t = this.t + passed;
      if (t >= Number(this.slider.max)) return this.pause();
      await this.seek(t);
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  pause() { this.playing = false; this.app.byId("play").textContent = "▶"; }
}

// the last index whose value is not above v, -1 before the first
function search(values, v) {
  let low = 0, high = values.length;
  while (low < high) { const mid = (low + high) >> 1; if (values[mid] <= v) low = mid + 1; else high = mid; }
  return low - 1;
}

function nearest(values, v) {
  const i = search(values, v);
  if (i < 0) return 0;
  return i + 1 < values.length && values[i + 1] - v < v - values[i] ? i + 1 : i;
}
