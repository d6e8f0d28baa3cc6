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
  signs.verdicts = new Map();
  signs.shown = new Uint8Array(signs.n).fill(1);
  signs.count = signs.n;
  return signs;
}

function empty() {
  const none = new Float64Array(0);
  return { n: 0, ids: [], classes: [], statuses: [], drives: [], x: none, y: none, verdicts: new Map(), shown: none, count: 0 };
}

// a corrected position stands in place of the computed one
export function place(signs, row) {
  const v = signs.verdicts.get(row);
  if (v && v.lon_deg !== undefined) return mercator(v.lon_deg, v.lat_deg);
  return [signs.x[row], signs.y[row]];
}

export const classOf = (signs, row) => signs.verdicts.get(row)?.class_name ?? signs.classes[signs.class[row]];

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
    let on = classes[signs.class[i]] && !(signs.confidence[i] < confidence);
    if (on && drives && starts[i] < starts[i + 1]) {
      on = false;
      for (let k = starts[i]; k < starts[i + 1] && !on; k++) on = drives[members[k]];
    }
    if (on && review !== "all") {
      const status = signs.verdicts.get(i)?.status || "open";
      on = status === review;
    }
    signs.shown[i] = on ? 1 : 0;
    count += on ? 1 : 0;
  }
  signs.count = count;
}

// the words of a class name: the middle parts of regulatory--stop--g1
export function words(name) {
  const parts = name.split("--").filter((part) => !/^g\d+$/.test(part));
  return (parts.length > 1 ? parts.slice(1) : parts).join(" ").replace(/-/g, " ") || "without class";
}
