// Decisions about signs: sent one by one, shown when the server has them on disk.
import * as api from "./api.js";
import { geographic, metresPerUnit, place } from "./signs.js";

const POLL_MS = 3000;

export class Review {
  constructor(app) { this.app = app; this.count = -1; this.last = null; }

  // the state that the server tells
  take(told) {
    if (told.verdicts === undefined) return;
    this.count = told.count;
    this.last = told.last[0] ?? null;
    const { signs } = this.app.state;
    signs.verdicts.clear();
    for (const v of told.verdicts) if (v.row !== null) signs.verdicts.set(v.row, v);
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
    if (row === null) return false;
    try {
      this.take(await api.post("api/review", { row, ...action }));
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

  async undo() {
    if (!this.last) return this.app.hint("There is nothing to undo.");
    const { signs, selected } = this.app.state;
    const found = [...signs.verdicts].find(([, v]) => v.sign === this.last.sign);
    const row = found ? found[0] : signs.ids.indexOf(this.last.sign);
    const { kind, sign, id } = this.last;
    if (await this.send(row >= 0 ? row : selected, { kind: "undo", undoes: id })) this.app.hint(`Undone: ${kind} of ${sign}`);
  }

  // moving a sign: a place of its own until it is saved
  startMove() {
    const { state, hint, byId } = this.app;
    if (state.selected === null) return;
    state.moving = place(state.signs, state.selected);
    byId("canvas").classList.add("moving");
    byId("canvas").focus();
    this.app.map.centre(...state.moving, 14);
    hint("Drag the sign or use the arrows (0.1 m, with shift 1 m). Enter saves, Esc leaves it.");
  }

  nudge(dx, dy) {
    const { state } = this.app;
    if (!state.moving) return;
    state.moving = [state.moving[0] + dx, state.moving[1] + dy];
    this.app.map.redraw();
  }

  nudgeMetres(east, north) {
    const unit = metresPerUnit(this.app.state.moving[1]);
    this.nudge(east / unit, -north / unit);
  }

  cancelMove() {
    this.app.state.moving = null;
    this.app.byId("canvas").classList.remove("moving");
    this.app.hint("");
    this.app.map.redraw();
  }

  async saveMove() {
    const { state } = this.app;
    if (!state.moving) return;
    const [lon, lat] = geographic(...state.moving);
    if (await this.send(state.selected, { kind: "correct", lon_deg: lon, lat_deg: lat })) this.cancelMove();
  }
}
