// Signs on the map: single ones with ellipse and direction, many near one another as one disc.
import { COLOURS, classOf, facingOf, isGone, mercator, metresPerUnit, place } from "./signs.js";

const CELL = 52;           // pixels of a cell of the cluster grid, at least
const APART_PX = 38;       // discs nearer than this are one
const FACES = 500;         // more signs in view than this are drawn as dots
const APART = 14;          // pixels per metre from which signs are never put together
export const RING = { accepted: "--good", rejected: "--bad", corrected: "--warn", added: "--accent" };

// scratch arrays of the cluster grid, kept from one drawing to the next
let sum = new Float64Array(0), grid = { n: new Uint32Array(0), first: new Uint32Array(0) };

export function drawSigns(map, state) {
  const { signs } = state;
  const drawn = [];
  const singles = map.pxPerM >= APART ? inView(map, signs) : clustered(map, signs, drawn, state);
  const chosen = state.selected;
  if (chosen !== null && !isGone(signs, chosen) && !singles.includes(chosen)) singles.push(chosen);
  const faces = singles.length <= FACES;
  for (const row of singles) if (map.pxPerM > 0.4 || row === chosen) ellipse(map, state, row, row === chosen);
  for (const row of singles) if (row !== chosen) drawn.push(single(map, state, row, faces));
  if (chosen !== null && !isGone(signs, chosen)) drawn.push(single(map, state, chosen, true));
  return drawn;
}

function inView(map, signs) {
  const rows = [];
  const x0 = map.wx(-30), x1 = map.wx(map.w + 30), y0 = map.wy(-30), y1 = map.wy(map.h + 30);
  for (let i = 0; i < signs.n; i++) {
    if (signs.shown[i] && signs.x[i] > x0 && signs.x[i] < x1 && signs.y[i] > y0 && signs.y[i] < y1) rows.push(i);
  }
  return rows;
}

// cells keep their place in the world between half steps of zoom, so that discs do not jump
function clustered(map, signs, drawn, state) {
  const cell = CELL / 2 ** (Math.floor(2 * Math.log2(map.k)) / 2);
  const cx0 = Math.floor(map.wx(0) / cell) - 1, cy0 = Math.floor(map.wy(0) / cell) - 1;
  const columns = Math.ceil(map.w / map.k / cell) + 3, rows = Math.ceil(map.h / map.k / cell) + 3;
  const cells = columns * rows;
  if (grid.n.length < cells) {
    grid = { n: new Uint32Array(cells), first: new Uint32Array(cells) };
    sum = new Float64Array(cells * 6);
  }
  const { n, first } = grid;
  n.fill(0, 0, cells);
  const { x, y, shown } = signs;
  for (let i = 0; i < signs.n; i++) {
    if (!shown[i]) continue;
    const cx = Math.floor(x[i] / cell) - cx0, cy = Math.floor(y[i] / cell) - cy0;
    // a sign without a position is in no cell, for NaN is not below anything
    if (!(cx >= 0 && cx < columns && cy >= 0 && cy < rows)) continue;
    const c = cy * columns + cx, s = 6 * c;
    if (n[c]++ === 0) {
      first[c] = i;
      sum[s] = x[i]; sum[s + 1] = y[i];
      sum[s + 2] = sum[s + 4] = x[i]; sum[s + 3] = sum[s + 5] = y[i];
    } else {
      sum[s] += x[i]; sum[s + 1] += y[i];
      if (x[i] < sum[s + 2]) sum[s + 2] = x[i];
      if (y[i] < sum[s + 3]) sum[s + 3] = y[i];
      if (x[i] > sum[s + 4]) sum[s + 4] = x[i];
      if (y[i] > sum[s + 5]) sum[s + 5] = y[i];
    }
  }
  return gathered(map, drawn, cells, columns);
}

// a town on the border of cells is one disc: cells take in neighbours that would overlap
function gathered(map, drawn, cells, columns) {
  const { n, first } = grid;
  const order = [];
  for (let c = 0; c < cells; c++) if (n[c]) order.push(c);
  order.sort((a, b) => n[b] - n[a]);
  const near = [-columns - 1, -columns, -columns + 1, -1, 1, columns - 1, columns, columns + 1];
  const singles = [];
  for (const c of order) {
    if (!n[c]) continue;
    const s = sum.subarray(6 * c, 6 * c + 6);
    let count = n[c];
    n[c] = 0;
    const x = s[0] / count, y = s[1] / count;
    for (const step of near) {
      const o = c + step;
      if (!(o >= 0 && o < cells && n[o])) continue;
      const t = sum.subarray(6 * o, 6 * o + 6);
      if (Math.hypot(t[0] / n[o] - x, t[1] / n[o] - y) * map.k > APART_PX) continue;
      count += n[o];
      n[o] = 0;
      s[0] += t[0]; s[1] += t[1];
      s[2] = Math.min(s[2], t[2]); s[3] = Math.min(s[3], t[3]);
      s[4] = Math.max(s[4], t[4]); s[5] = Math.max(s[5], t[5]);
    }
    if (count === 1) singles.push(first[c]);
    else drawn.push(disc(map, count, s));
  }
  return singles;
}

function disc(map, count, s) {
  const { ctx } = map;
  const sx = map.sx(s[0] / count), sy = map.sy(s[1] / count);
  const r = 11 + 2.6 * Math.log2(count) ** 0.9;
  ctx.beginPath();
  ctx.arc(sx, sy, Math.min(r, 30), 0, 7);
  ctx.globalAlpha = 0.88;
  ctx.fillStyle = map.colour("--card"); ctx.fill();
  ctx.globalAlpha = 1;
  ctx.lineWidth = 2; ctx.strokeStyle = map.colour("--accent"); ctx.stroke();
  ctx.fillStyle = map.colour("--ink");
  ctx.font = "600 12px system-ui, sans-serif";
  ctx.textAlign = "center"; ctx.textBaseline = "middle";
  ctx.fillText(count < 1000 ? count : count < 10000 ? `${(count / 1000).toFixed(1)}k` : `${Math.round(count / 1000)}k`, sx, sy + 0.5);
  return { sx, sy, r: Math.min(r, 30), count, box: [s[2], s[3], s[4], s[5]] };
}

function ellipse(map, state, row, chosen) {
  const { ctx } = map, { signs } = state;
  const v = signs.verdicts.get(row);
  const moved = v && v.lon_deg !== undefined;
  const px = map.k / metresPerUnit(signs.y[row]);
  const hand = 2.448 * (v?.sd_m ?? 1);
  const by = (name) => (v?.major !== undefined ? v[name] : signs[name][row]);
  const round = moved && v.major === undefined;
  const major = (round ? hand : by("major")) * px, minor = (round ? hand : by("minor")) * px;
  if (!(major > 3) || major > 20000) return;
  const [x, y] = place(signs, row);
  ctx.beginPath();
  ctx.ellipse(map.sx(x), map.sy(y), major, Math.max(minor, 0.5), round ? 0 : by("azimuth") - Math.PI / 2, 0, 7);
  const colour = COLOURS[signs.class[row] % COLOURS.length];
  ctx.fillStyle = ctx.strokeStyle = colour;
  ctx.globalAlpha = chosen ? 0.16 : 0.07; ctx.fill();
  ctx.globalAlpha = chosen ? 1 : 0.6; ctx.lineWidth = chosen ? 1.6 : 1; ctx.stroke();
  ctx.globalAlpha = 1;
}

function single(map, state, row, faces) {
  const { ctx } = map, { signs } = state;
  const chosen = row === state.selected;
  const verdict = signs.verdicts.get(row);
  let [x, y] = place(signs, row);
  if (chosen && state.moving) { line(map, x, y, state.moving); [x, y] = state.moving; }
  const sx = map.sx(x), sy = map.sy(y);
  const r = chosen ? 15 : faces ? 11 : 5;
  const colour = COLOURS[signs.class[row] % COLOURS.length];
  const facing = chosen && state.turning !== null ? state.turning : facingOf(signs, row);
  if (facing === facing && (faces || chosen)) {
    // of the chosen one from its rings on, which would hide it
    const from = chosen ? r + 6 : r, angle = facing * Math.PI / 180;
    if (map.below?.on) arrow(ctx, sx, sy, from, angle, map.colour("--card"), 4.5);
    arrow(ctx, sx, sy, from, angle, chosen && state.turning !== null ? map.colour("--warn") : colour, chosen ? 2.6 : 1.8);
  }
  const face = faces ? state.face(classOf(signs, row)) : null;
  ctx.globalAlpha = verdict?.status === "rejected" ? 0.35 : 1;
  if (face) ctx.drawImage(face, sx - r, sy - r, 2 * r, 2 * r);
  else {
    ctx.beginPath(); ctx.arc(sx, sy, faces ? r * 0.62 : r, 0, 7);
    ctx.fillStyle = colour; ctx.fill();
    ctx.lineWidth = 1.4; ctx.strokeStyle = map.colour("--card"); ctx.stroke();
  }
  ctx.globalAlpha = 1;
  if (verdict && RING[verdict.status]) ring(map, sx, sy, r + 2, map.colour(RING[verdict.status]), verdict.status === "rejected");
  if (chosen) ring(map, sx, sy, r + 5, map.colour("--accent"), false);
  return { sx, sy, r: r + 2, row };
}

// a sign that is being added: where it was clicked, or where the frames meet
export function drawAdding(map, state) {
  const { adding } = state;
  if (!adding) return;
  const { ctx } = map;
  const at = adding.at ?? (adding.preview ? mercator(adding.preview.lon_deg, adding.preview.lat_deg) : null);
  if (!at) return;
  const sx = map.sx(at[0]), sy = map.sy(at[1]);
  const px = map.k / metresPerUnit(at[1]);
  const { major = 2.448, minor = 2.448, azimuth = 0 } = adding.preview ?? {};
  ctx.beginPath();
  ctx.ellipse(sx, sy, Math.max(major * px, 1), Math.max(minor * px, 1), azimuth - Math.PI / 2, 0, 7);
  ctx.fillStyle = ctx.strokeStyle = map.colour("--accent");
  ctx.globalAlpha = 0.2; ctx.fill();
  ctx.globalAlpha = 1; ctx.lineWidth = 2; ctx.stroke();
  for (const [colour, width] of [[map.colour("--card"), 6], [map.colour("--accent"), 3]]) {
    ctx.strokeStyle = colour; ctx.lineWidth = width;
    ctx.beginPath();
    ctx.moveTo(sx - 12, sy); ctx.lineTo(sx + 12, sy); ctx.moveTo(sx, sy - 12); ctx.lineTo(sx, sy + 12);
    ctx.stroke();
  }
}

function ring(map, sx, sy, r, colour, crossed) {
  const { ctx } = map;
  ctx.strokeStyle = colour; ctx.lineWidth = 2.4;
  ctx.beginPath(); ctx.arc(sx, sy, r, 0, 7);
  if (crossed) { ctx.moveTo(sx - r * 0.7, sy + r * 0.7); ctx.lineTo(sx + r * 0.7, sy - r * 0.7); }
  ctx.stroke();
}

function arrow(ctx, sx, sy, r, angle, colour, width) {
  const far = r + 13, s = Math.sin(angle), c = -Math.cos(angle);
  ctx.strokeStyle = colour; ctx.lineWidth = width;
  ctx.beginPath();
  ctx.moveTo(sx + s * r, sy + c * r); ctx.lineTo(sx + s * far, sy + c * far);
  for (const turn of [2.6, -2.6]) {
    ctx.moveTo(sx + s * far, sy + c * far);
    ctx.lineTo(sx + s * far + 6 * Math.sin(angle + turn), sy + c * far - 6 * Math.cos(angle + turn));
  }
  ctx.stroke();
}

function line(map, x, y, to) {
  const { ctx } = map;
  ctx.strokeStyle = map.colour("--warn"); ctx.lineWidth = 1.5; ctx.setLineDash([5, 4]);
  ctx.beginPath(); ctx.moveTo(map.sx(x), map.sy(y)); ctx.lineTo(map.sx(to[0]), map.sy(to[1])); ctx.stroke();
  ctx.setLineDash([]);
}
