// The background: web map tiles of the server's own, drawn below everything.
import * as api from "./api.js";

const KEPT = 400;      // tiles in memory
const AT_ONCE = 6;     // requests under way
const MOST = 120;      // tiles of one picture; from further out nothing would be seen of them

export class Below {
  constructor(map, info) {
    this.map = map; this.info = info; this.on = true;
    this.tiles = new Map(); this.wanted = []; this.busy = 0;
    const [west, south, east, north] = info.bounds;
    const y = (lat) => 0.5 - Math.asinh(Math.tan(Math.max(-85, Math.min(85, lat)) * Math.PI / 180)) / (2 * Math.PI);
    this.box = [(west + 180) / 360, y(north), (east + 180) / 360, y(south)];
  }

  // true where something of the background is in view
  draw(ctx) {
    if (!this.on) return false;
    const { map, info } = this;
    const wanted = Math.round(Math.log2(map.k * map.ratio / info.tile_px));
    const z = Math.min(Math.max(wanted, info.least_zoom), info.most_zoom);
    const n = 2 ** z;
    const x0 = Math.floor(Math.max(map.wx(0), this.box[0]) * n), x1 = Math.ceil(Math.min(map.wx(map.w), this.box[2]) * n) - 1;
    const y0 = Math.floor(Math.max(map.wy(0), this.box[1]) * n), y1 = Math.ceil(Math.min(map.wy(map.h), this.box[3]) * n) - 1;
    if (x1 < x0 || y1 < y0 || (x1 - x0 + 1) * (y1 - y0 + 1) > MOST) { this.wanted = []; return false; }
    this.wanted = [];
    for (let y = y0; y <= y1; y++) for (let x = x0; x <= x1; x++) this.one(ctx, z, x, y);
    this.fetch();
    return true;
  }

  one(ctx, z, x, y) {
    const { map } = this;
    const known = this.tiles.get(`${z}/${x}/${y}`);
    if (known === undefined) this.wanted.push([z, x, y]);
    // whole pixels, so that no seams show
    const left = Math.round(map.sx(x / 2 ** z)), top = Math.round(map.sy(y / 2 ** z));
    const wide = Math.round(map.sx((x + 1) / 2 ** z)) - left, high = Math.round(map.sy((y + 1) / 2 ** z)) - top;
    if (known) { this.keep(`${z}/${x}/${y}`, known); ctx.drawImage(known, left, top, wide, high); return; }
    if (known === null) return;
    // until it is there, what a wider one shows of it
    for (let up = 1; up <= Math.min(5, z); up++) {
      const parent = this.tiles.get(`${z - up}/${x >> up}/${y >> up}`);
      if (!parent) continue;
      const part = parent.width / 2 ** up;
      ctx.drawImage(parent, (x % 2 ** up) * part, (y % 2 ** up) * part, part, part, left, top, wide, high);
      return;
    }
  }

  keep(key, bitmap) {
    this.tiles.delete(key);
    this.tiles.set(key, bitmap);
    if (this.tiles.size <= KEPT) return;
    const [oldest, old] = this.tiles.entries().next().value;
    old?.close();
    this.tiles.delete(oldest);
  }

  async fetch() {
    while (this.busy < AT_ONCE && this.wanted.length) {
      const [z, x, y] = this.wanted.shift();
      const key = `${z}/${x}/${y}`;
      if (this.tiles.has(key)) continue;
      this.busy++;
      this.tiles.set(key, undefined);
      api.tile(`below/${key}`).catch(() => null).then((bitmap) => {
        this.busy--;
        this.keep(key, bitmap);
        this.map.redraw();
      });
    }
  }
}
