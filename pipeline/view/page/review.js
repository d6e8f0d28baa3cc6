// Decisions about signs: sent one by one, shown when the server has them on disk.
import * as api from "./api.js";
import { facingOf, geographic, grow, mercator, metresPerUnit, place } from "./signs.js";

const POLL_MS = 3000;

export class Review {
  constructor(app) {
    this.app = app; this.count = -1; this.last = {};
    const { byId, overview } = app;
    this.who = byId("reviewer");
    this.who.value = sessionStorage.getItem("reviewer") ?? overview.reviewer;
    this.who.onchange = () => sessionStorage.setItem("reviewer", this.name);
    byId("add").onclick = () => this.startAdd();
    byId("mode-keep").onclick = () => this.save();
    byId("mode-leave").onclick = () => this.leave();
  }

  get name() { return this.who.value.trim(); }

  // the state that the server tells
  take(told) {
    if (told.verdicts === undefined) return;
    this.count = told.count;
    this.last = told.last;
    const { signs } = this.app.state;
    grow(signs, told.made);
    signs.verdicts.clear();
    for (const v of told.verdicts) if (v.row !== null) signs.verdicts.set(v.row, v);
    this.app.byId("reviewers").replaceChildren(...told.reviewers.map((name) => new Option(name)));
    this.app.order = null;
    if (this.app.card) { this.app.refilter(); this.app.card.refresh(); }
  }

  // another tab, or another program, may have decided something too
  watch() {
    const ask = async () => {
      try { if (!document.hidden) this.take(await api.json(`api/review?known=${this.count}`)); }
      catch { this.app.hint("The viewer's server does not answer; start automap view again. Decisions are not saved until then."); return; }
      setTimeout(ask, POLL_MS);
    };
    setTimeout(ask, POLL_MS);
  }

  async send(row, action) {
    if (row === null && action.kind !== "add" && action.kind !== "undo") return false;
    const settles = Boolean(this.app.state.signs.verdicts.get(row)?.disputed) && ["accept", "reject", "correct"].includes(action.kind);
    try {
      this.take(await api.post("api/review", { row, reviewer: this.name, settles, ...action }));
      this.app.hint("");
      return true;
    } catch (error) {
      this.app.hint(`Not saved: ${error.message}`);
      return false;
    }
  }

  accept() { return this.send(this.app.state.selected, { kind: "accept" }); }
  reject() { return this.send(this.app.state.selected, { kind: "reject" }); }
  reset() { return this.send(this.app.state.selected, { kind: "reset" }); }
  setClass(name) { return this.send(this.app.state.selected, { kind: "correct", class_name: name }); }
  note(text) { return this.send(this.app.state.selected, { kind: "note", note: text }); }
  turn(deg) { return this.send(this.app.state.selected, { kind: "correct", facing_deg: ((deg % 360) + 360) % 360 }); }
  raise(metres) { return this.send(this.app.state.selected, { kind: "correct", height_above_road_m: metres }); }

  async chooseClass() {
    const { state, picker, card } = this.app;
    const row = state.selected;
    if (row === null) return;
    const name = await picker.choose(card.className());
    if (name && state.selected === row) await this.setClass(name);
    this.app.byId("class-button")?.focus();
  }

  // what this reviewer did last
  async undo() {
    const last = this.last[this.name];
    if (!last) return this.app.hint("There is nothing of yours to undo.");
    if (await this.undoAction(last.id)) this.app.hint(`Undone: ${last.kind} of ${last.sign}`);
  }

  undoAction(id) { return this.send(this.app.state.selected, { kind: "undo", undoes: id }); }

  // --- moving a sign: a place of its own until it is saved
  startMove() {
    const { state, hint } = this.app;
    if (state.selected === null) return;
    this.leave();
    state.moving = place(state.signs, state.selected);
    this.begin();
    this.app.map.centre(...state.moving, 14);
    hint("Drag the sign or use the arrows (0.1 m, with shift 1 m). Enter saves, Esc leaves it.");
  }

  // --- turning it
  startTurn() {
    const { state, hint } = this.app;
    if (state.selected === null) return;
    this.leave();
    const now = facingOf(state.signs, state.selected);
    state.turning = now === now ? now : 0;
    this.begin();
    this.app.map.centre(...place(state.signs, state.selected), 14);
    hint("Drag round the sign or use the arrows (1°, with shift 10°). Enter saves, Esc leaves it.");
  }

  // --- one with another
  startMerge() {
    const { state, hint } = this.app;
    if (state.selected === null) return;
    this.leave();
    state.merging = true;
    this.begin();
    hint("Click the sign that is the same one, or go to it with n and p and press Enter. Esc leaves it.");
    state.mergeInto = state.selected;
  }

  async merge(other) {
    const { state } = this.app;
    const row = state.mergeInto;
    if (other === row) return;
    this.leave();
    if (await this.send(row, { kind: "merge", other })) { await this.app.select(row, false); this.app.hint("The two are one sign now."); }
  }

  // --- a sign that was missed
  async startAdd() {
    const { state, card } = this.app;
    this.leave();
    await this.app.select(null);
    state.adding = { at: null, clicks: [], preview: null, name: "" };
    this.begin();
    this.app.byId("frame").tabIndex = 0;
    this.app.byId("side").classList.add("adding");
    // the frame is to be clicked in
    this.app.byId("side").scrollTop = 0;
    card.drawAdding();
    this.app.hint("");
  }

  clickMap(x, y) {
    const { state } = this.app;
    if (!state.adding) return;
    state.adding.at = [x, y];
    state.adding.clicks = []; state.adding.preview = null;
    this.addingChanged();
  }

  clickFrame(click) {
    const { adding } = this.app.state;
    if (!adding) return;
    adding.at = null;
    const same = (c) => c.drive === click.drive && c.camera === click.camera && c.frame === click.frame;
    adding.clicks = [...adding.clicks.filter((c) => !same(c)), click];
    this.addingChanged();
  }

  async addingChanged() {
    const { state, card } = this.app;
    const { adding } = state;
    adding.preview = null; adding.trouble = "";
    if (adding.clicks.length > 1) {
      try {
        const found = await api.post("api/place", { views: this.views(adding) });
        if (state.adding !== adding) return;
        adding.preview = found;
        this.app.map.centre(...mercator(found.lon_deg, found.lat_deg), 6);
      } catch (error) { adding.trouble = error.message; }
    }
    if (state.adding !== adding) return;
    card.drawAdding();
    this.app.player.paint();
    this.app.map.redraw();
  }

  views(adding) {
    const { drives } = this.app.overview;
    return adding.clicks.map((c) => [drives[c.drive], c.camera, c.frame, c.x, c.y]);
  }

  async saveAdd() {
    const { state } = this.app;
    const { adding } = state;
    if (!adding || (!adding.at && !adding.preview)) return this.app.hint("Click where it stands first: on the map, or in two frames.");
    if (!adding.name) {
      adding.name = await this.app.picker.choose() ?? "";
      if (!adding.name || state.adding !== adding) return;
      this.app.card.drawAdding();
    }
    const action = { kind: "add", class_name: adding.name };
    if (adding.at) [action.lon_deg, action.lat_deg] = geographic(...adding.at);
    else action.views = this.views(adding);
    if (!await this.send(null, action)) return;
    this.leave();
    await this.app.select(state.signs.n - 1, false);
    this.app.hint("Added.");
  }

  // --- two signs of one
  startSplit() {
    const { state, card, hint } = this.app;
    const views = card.sign?.views ?? [];
    if (state.selected === null || views.length < 2) return hint("A sign of one view cannot be split.");
    this.leave();
    state.splitting = new Set(views.map((_, i) => i).filter((i) => i > 0 && i >= card.view));
    this.begin();
    card.draw();
    this.app.byId("views").scrollIntoView({ block: "center" });
    hint("Choose the views of the other sign, then Make two signs. Esc leaves it.");
  }

  async saveSplit() {
    const { state, card, overview } = this.app;
    const row = state.selected;
    const views = [...state.splitting].map((i) => card.sign.views[i]).map((v) => [overview.drives[v.drive], v.camera, v.frame]);
    if (await this.send(row, { kind: "split", views })) { this.leave(); await this.app.select(row, false); this.app.hint("Two signs now; look at the class of both."); }
  }

  // --- all of these
  begin() {
    const canvas = this.app.byId("canvas");
    canvas.classList.add("moving");
    canvas.focus();
    const { state } = this.app;
    // a panel of its own has these buttons too
    this.app.byId("mode").hidden = Boolean(state.adding || state.splitting);
    this.app.byId("mode-keep").hidden = state.merging;
    this.app.map.redraw();
  }

  get busy() { const { state } = this.app; return Boolean(state.moving || state.turning !== null || state.merging || state.adding || state.splitting); }

  leave() {
    const { state, card } = this.app;
    const panel = state.adding || state.splitting;
    Object.assign(state, { moving: null, turning: null, merging: false, adding: null, splitting: null });
    this.app.byId("canvas").classList.remove("moving");
    this.app.byId("mode").hidden = true;
    this.app.byId("frame").removeAttribute("tabindex");
    this.app.byId("side").classList.remove("adding");
    this.app.hint("");
    if (panel) card.draw();
    this.app.player?.paint();
    this.app.map.redraw();
  }

  async save() {
    const { state } = this.app;
    if (state.moving) {
      const [lon, lat] = geographic(...state.moving);
      if (await this.send(state.selected, { kind: "correct", lon_deg: lon, lat_deg: lat })) this.leave();
    } else if (state.turning !== null) {
      if (await this.turn(state.turning)) this.leave();
    } else if (state.merging) {
      if (state.selected !== null) await this.merge(state.selected);
    } else if (state.adding) await this.saveAdd();
    else if (state.splitting) await this.saveSplit();
  }

  // the pointer draws a sign along, or round
  drag(dx, dy, x, y) {
    const { state } = this.app;
    if (state.moving) state.moving = [state.moving[0] + dx, state.moving[1] + dy];
    else if (state.turning !== null) {
      const [sx, sy] = place(state.signs, state.selected);
      state.turning = (Math.atan2(x - sx, sy - y) * 180 / Math.PI + 360) % 360;
    }
    this.app.map.redraw();
  }

  // an arrow key, in steps to the right and up
  nudge(right, up, far) {
    const { state } = this.app;
    if (state.turning !== null) state.turning = (state.turning + (right + up) * (far ? 10 : 1) + 360) % 360;
    else {
      const at = state.moving ?? state.adding?.at;
      if (!at) return false;
      const unit = metresPerUnit(at[1]), step = (far ? 1 : 0.1) / unit;
      const next = [at[0] + right * step, at[1] - up * step];
      if (state.moving) state.moving = next; else state.adding.at = next;
    }
    this.app.map.redraw();
    return true;
  }
}
