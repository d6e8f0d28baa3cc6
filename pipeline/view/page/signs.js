// All signs as typed arrays, and which of them the filters let through.
const TYPES = { f8: Float64Array, f4: Float32Array, u4: Uint32Array, u2: Uint16Array, u1: Uint8Array };
const style = getComputedStyle(document.documentElement);
export const css = (name) => style.getPropertyValue(name).trim();
export const COLOURS = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => css(`--c${k}`));

export function parse(buffer) {
  if (!buffer.byteLength) return empty();
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const signs = { n: header.n, ids: header.ids, classes: header.classes, statuses: header.statuses, drives: header.drives };
  for (const a of header.arrays) signs[a.name] = new TYPES[a.type](buffer, 4 + length + a.at, a.n);
  return ready(signs);
}

function empty() {
  const signs = { n: 0, ids: [], classes: [], statuses: [], drives: [], drive_starts: new Uint32Array(1), drive_members: new Uint32Array(0) };
  for (const name of ["x", "y"]) signs[name] = new Float64Array(0);
  for (const name of ["confidence", "existence", "facing", "major", "minor", "azimuth"]) signs[name] = new Float32Array(0);
  for (const name of ["class", "status"]) signs[name] = new Uint32Array(0);
  return ready(signs);
}

const GROWING = ["x", "y", "confidence", "existence", "facing", "major", "minor", "azimuth", "class", "status"];

function ready(signs) {
  signs.verdicts = new Map();
  signs.shown = new Uint8Array(signs.n).fill(1);
  signs.gone = new Set();
  signs.count = signs.n;
  // the map's own, before any sign that the review made
  signs.own = { n: signs.n, ids: signs.ids.slice() };
  for (const name of GROWING) signs.own[name] = signs[name];
  return signs;
}

// signs that the review made stand behind the map's own
export function grow(signs, made) {
  const { own } = signs;
  const n = own.n + made.length;
  if (!made.length && signs.n === own.n) return;
  signs.ids = [...own.ids, ...made.map((m) => m.id)];
  for (const name of GROWING) {
    const array = new own[name].constructor(n);
    array.set(own[name]);
    signs[name] = array;
  }
  signs.gone.clear();
  made.forEach((m, k) => {
    const i = own.n + k;
    let number = signs.classes.indexOf(m.class);
    if (number < 0) number = signs.classes.push(m.class) - 1;
    signs.class[i] = number;
    signs.status[i] = signs.statuses.length;
    [signs.x[i], signs.y[i]] = m.lon_deg === undefined ? [NaN, NaN] : mercator(m.lon_deg, m.lat_deg);
    for (const name of ["confidence", "existence", "facing", "major", "minor", "azimuth"]) signs[name][i] = m[name] ?? NaN;
    if (m.lon_deg === undefined) signs.gone.add(i);
  });
  signs.n = n;
  const shown = new Uint8Array(n).fill(1);
  shown.set(signs.shown.subarray(0, Math.min(n, signs.shown.length)));
  signs.shown = shown;
}

// a corrected position stands in place of the computed one
export function place(signs, row) {
  const v = signs.verdicts.get(row);
  if (v && v.lon_deg !== undefined) return mercator(v.lon_deg, v.lat_deg);
  return [signs.x[row], signs.y[row]];
}

export const classOf = (signs, row) => signs.verdicts.get(row)?.class_name ?? signs.classes[signs.class[row]];
export const facingOf = (signs, row) => signs.verdicts.get(row)?.facing_deg ?? signs.facing[row];
// taken off by an undo, or one with another sign now
export const isGone = (signs, row) => signs.gone.has(row) || signs.verdicts.get(row)?.status === "merged";

export function mercator(lon, lat) {
  return [(lon + 180) / 360, 0.5 - Math.asinh(Math.tan(lat * Math.PI / 180)) / (2 * Math.PI)];
}

export function geographic(x, y) {
  return [x * 360 - 180, Math.atan(Math.sinh((0.5 - y) * 2 * Math.PI)) * 180 / Math.PI];
}

export const metresPerUnit = (y) => 40075016.686 / Math.cosh((0.5 - y) * 2 * Math.PI);

export function applyFilter(signs, filter) {
  const { classes, drives, confidence, review } = filter;
  const starts = signs.drive_starts, members = signs.drive_members;
  let count = 0;
  for (let i = 0; i < signs.n; i++) {
    // classes and drives that came with the review have no tick
    let on = classes[signs.class[i]] !== 0 && !(signs.confidence[i] < confidence) && !isGone(signs, i);
    if (on && drives && starts[i] < starts[i + 1]) {
      on = false;
      for (let k = starts[i]; k < starts[i + 1] && !on; k++) on = drives[members[k]];
    }
    if (on && review !== "all") {
      const v = signs.verdicts.get(i);
      on = review === "disputed" ? Boolean(v?.disputed) : (v?.status || "open") === review;
    }
    signs.shown[i] = on ? 1 : 0;
    count += on ? 1 : 0;
  }
  signs.count = count;
}

// how much a sign wants a look: reviewers who disagree, a status that is not "ok", little belief
export function doubt(signs, row) {
  const belief = (v) => (v === v ? v : 0.5);
  const sure = Math.min(belief(signs.confidence[row]), belief(signs.existence[row]));
  const flagged = (signs.statuses[signs.status[row]] ?? "ok") !== "ok";
  return (signs.verdicts.get(row)?.disputed ? 2 : 0) + (flagged ? 1 : 0) + 1 - sure;
}

// rows in the order in which they are gone through
export function ordered(signs, by) {
  const rows = Array.from({ length: signs.n }, (_, i) => i);
  if (by !== "doubt") return rows;
  const doubts = rows.map((i) => doubt(signs, i));
  return rows.sort((a, b) => doubts[b] - doubts[a] || a - b);
}

// the words of a class name: the middle parts of regulatory--stop--g1
export function words(name) {
  const parts = name.split("--").filter((part) => !/^g\d+$/.test(part));
  return (parts.length > 1 ? parts.slice(1) : parts).join(" ").replace(/-/g, " ") || "without class";
}

// the same of many, with the kind where two share them: a roundabout is warned of, and ordered
export function wordsApart(names) {
  const said = names.map(words);
  const shared = (name, k) => said.some((one, i) => i !== k && one === said[k]) && name.includes("--");
  return names.map((name, k) => (shared(name, k) ? `${said[k]} (${name.split("--")[0]})` : said[k]));
}
