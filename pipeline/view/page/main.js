// Puts the page together.
import * as api from "./api.js";
import { Below } from "./below.js";
import { Card } from "./card.js";
import { Filters } from "./filters.js";
import { listenToKeys } from "./keys.js";
import { SignMap } from "./map.js";
import { Picker } from "./picker.js";
import { Player } from "./player.js";
import { Review } from "./review.js";
import { applyFilter, css, isGone, parse, place } from "./signs.js";

const byId = (id) => document.getElementById(id);
const SIGMA = [0, 1, 2, 3, 4].map((k) => css(`--s${k}`));
const PATHS_AT_ONCE = 60;

const state = {
  signs: parse(new ArrayBuffer(0)), paths: new Map(), drives: new Map(), selected: null, moving: null,
  turning: null, merging: false, mergeInto: null, adding: null, splitting: null, vehicle: null, frames: 0, face: () => null,
};
globalThis.automapState = state;

const hint = (text) => { byId("hint").textContent = text; };
const app = { state, hint, byId };

start().catch((error) => hint(`The map cannot be shown: ${error.message}`));

async function start() {
  const map = app.map = globalThis.automapMap = new SignMap(byId("canvas"), state);
  const [overview, buffer, review] = await Promise.all([api.json("api/map"), api.bytes("api/signs"), api.json("api/review")]);
  app.overview = overview;
  state.signs = parse(buffer);
  state.face = faces(map);
  document.title = `${overview.name} - AutoMap`;
  byId("title").textContent = overview.name;
  if (overview.report) {
    byId("report").href = api.address("out/report.html");
    byId("report").hidden = false;
  }
  layBelow(map);

  app.select = select;
  app.refilter = refilter;
  app.wholeMap = wholeMap;
  app.review = new Review(app);
  app.filters = new Filters(app);
  app.picker = new Picker(app);
  app.player = new Player(app);
  app.card = new Card(app);
  app.review.take(review);
  app.card.draw();
  map.onPick = (row) => (state.merging ? app.review.merge(row) : select(row, false));
  map.onMove = (...drag) => app.review.drag(...drag);
  map.onPlace = (x, y) => app.review.clickMap(x, y);
  byId("fit").onclick = wholeMap;
  byId("zoom-in").onclick = () => map.zoomBy(2);
  byId("zoom-out").onclick = () => map.zoomBy(0.5);
  listenToKeys(app);
  refilter();
  wholeMap();
  map.draw();
  document.documentElement.dataset.ready = String(Math.round(performance.now()));
  for (const text of overview.problems) hint(text);
  await loadPaths();
  app.review.watch();
}

function layBelow(map) {
  const { background } = app.overview;
  app.toggleBelow = () => hint("This map has no background; give one with --background.");
  if (!background) return;
  map.below = new Below(map, background);
  const box = byId("below"), tick = byId("below-on");
  box.hidden = false;
  box.lastElementChild.textContent = background.name;
  tick.onchange = () => {
    map.below.on = tick.checked;
    map.redraw();
  };
  app.toggleBelow = () => tick.click();
}

async function loadPaths() {
  let first = true;
  for (let k = 0; k < Math.min(app.overview.drives.length, PATHS_AT_ONCE); k++) {
    const drive = await app.player.load(k);
    if (!drive) continue;
    for (const text of drive.problems) hint(text);
    if (!first) continue;
    first = false;
    await app.player.show(k);
    if (!app.map.touched && state.selected === null) wholeMap();
  }
  legend();
  document.documentElement.dataset.paths = "loaded";
}

app.addPath = (k, path) => {
  if (!path) return;
  const known = path.sd_m.filter((v) => v !== null).sort((a, b) => a - b);
  if (!app.limits && known.length) {
    const at = (q) => known[Math.floor(q * (known.length - 1))];
    // colours for a tenth more or less would only confuse
    app.limits = at(0.95) > 1.15 * at(0.05) ? [0.2, 0.4, 0.6, 0.8].map(at) : [];
    app.typical = at(0.5);
  }
  const classOf = (sd) => (sd === null || !app.limits ? -1 : app.limits.filter((limit) => sd > limit).length);
  const runs = [];
  for (let i = 0; i + 1 < path.x.length; i++) {
    const c = classOf(path.sd_m[i]);
    // a path over the date line goes on at the other end of the map
    const jump = Math.abs(path.x[i + 1] - path.x[i]) > 0.5;
    const last = runs.at(-1);
    if (last && last.c === c && last.to === i && !jump) last.to = i + 1;
    else if (!jump) runs.push({ c, from: i, to: i + 1, colour: c < 0 ? css("--unknown") : SIGMA[c] });
  }
  state.paths.set(k, { x: path.x, y: path.y, runs });
  app.map.redraw();
};

function legend() {
  const box = byId("legend");
  box.replaceChildren();
  if (!app.limits) return;
  const text = (v) => (v < 10 ? v.toPrecision(2) : v.toFixed(0));
  const mark = (c) => { const e = document.createElement("i"); e.style.background = SIGMA[c]; box.append(e); };
  if (!app.limits.length) {
    box.append(`path σ about ${text(app.typical)} m`);
    return mark(0);
  }
  box.append(`path σ below ${text(app.limits[0])} m`);
  SIGMA.forEach((_, c) => mark(c));
  box.append(` above ${text(app.limits[3])} m`);
}

function bounds(rows) {
  const { signs } = state;
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const add = (x, y) => {
    if (!(x === x && y === y)) return;
    box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
  };
  for (let i = 0; i < signs.n; i++) if (!rows || rows[i]) add(signs.x[i], signs.y[i]);
  for (const path of state.paths.values()) for (let i = 0; i < path.x.length; i++) add(path.x[i], path.y[i]);
  return box;
}

function wholeMap() { app.map.fit(bounds(null)); }

function refilter() {
  applyFilter(state.signs, app.filters.values());
  const { signs } = state;
  let n = 0, reviewed = 0;
  for (let i = 0; i < signs.n; i++) if (!isGone(signs, i)) { n++; if (signs.verdicts.get(i)?.status) reviewed++; }
  const { count } = signs;
  byId("tally").textContent = `${count === n ? n : `${count} of ${n}`} signs, ${reviewed} reviewed`;
  byId("progress").max = Math.max(n, 1);
  byId("progress").value = reviewed;
  app.map.redraw();
}

async function select(row, centre = true) {
  if (app.review.busy && !state.merging) app.review.leave();
  state.selected = row;
  if (row !== null && centre) {
    const [x, y] = place(state.signs, row);
    app.map.centre(x, y, 3);
  }
  app.map.redraw();
  await app.card.show(row);
}

// pictures of classes, fetched when first drawn
function faces(map) {
  const pictures = new Map();
  return (name) => {
    if (!pictures.has(name)) {
      pictures.set(name, null);
      api.picture(`face/${encodeURIComponent(name)}`).then((bitmap) => { pictures.set(name, bitmap); map.redraw(); }, () => {});
    }
    return pictures.get(name);
  };
}
