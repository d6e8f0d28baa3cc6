// The card of one sign. Text of the recording is only ever set as text.
import * as api from "./api.js";
import { classOf, words } from "./signs.js";

const element = (tag, text, parent, className) => {
  const e = document.createElement(tag);
  if (text !== undefined && text !== null) e.textContent = text;
  if (className) e.className = className;
  if (parent) parent.append(e);
  return e;
};

const WORDS = { accept: "accepted", reject: "rejected", correct: "corrected", note: "note", reset: "reset", undo: "undone" };

export class Card {
  constructor(app) { this.app = app; this.box = app.byId("card"); this.sign = null; this.row = null; this.view = -1; }

  async show(row) {
    this.row = row;
    if (row === null) { this.sign = null; this.box.replaceChildren(element("p", "Click a sign, or press n for the first one. ? lists the keys.", null, "hint")); return; }
    let sign;
    try { sign = await api.json(`api/sign/${row}`); } catch (error) { this.app.hint(error.message); return; }
    // another sign may have been chosen in the meantime
    if (this.row !== row) return;
    this.sign = sign;
    this.view = -1;
    this.draw();
    this.app.player.marks();
    if (sign.views.length) {
      const largest = sign.views.reduce((best, v, i) => (v.height_px > sign.views[best].height_px ? i : best), 0);
      await this.showView(largest);
    }
  }

  async refresh() {
    const { row } = this;
    if (row === null || !this.sign) return;
    const sign = await api.json(`api/sign/${row}`).catch(() => null);
    // what is being typed is not taken away
    const busy = ["INPUT", "TEXTAREA"].includes(document.activeElement?.tagName) && this.box.contains(document.activeElement);
    if (sign && this.row === row) { this.sign.history = sign.history; if (!busy) this.draw(); }
  }

  draw() {
    const { signs } = this.app.state;
    const { sign, row, box } = this;
    const verdict = signs.verdicts.get(row);
    const name = classOf(signs, row);
    box.replaceChildren();
    const title = element("h2", undefined, box);
    const number = this.app.hasFace(name);
    if (number >= 0) {
      const picture = element("img", undefined, title);
      picture.alt = "";
      picture.src = api.address(`face/${number}`);
    }
    element("span", words(name), title);
    if (verdict?.status) element("span", verdict.status, title, `badge ${verdict.status}`);
    element("div", sign.id, box, "hint");
    this.buttons(box, verdict, name);
    this.views(box);
    this.figures(box, verdict);
    if (sign.history.length) {
      element("h3", "Review", box);
      const list = element("ol", undefined, box);
      list.id = "history";
      for (const h of sign.history) {
        element("li", [WORDS[h.kind], h.class, h.note, h.time.slice(0, 19).replace("T", " ") + " UTC"].filter(Boolean).join(", "), list);
      }
    }
  }

  buttons(box, verdict, name) {
    const { review } = this.app;
    const row = element("p", undefined, box, "row");
    const button = (id, text, title, action) => {
      const b = element("button", text, row);
      b.type = "button"; b.id = id; b.title = title;
      b.onclick = action;
      return b;
    };
    button("accept", "Accept", "The sign is right (a)", () => review.accept());
    button("reject", "Reject", "There is no such sign (x)", () => review.reject());
    button("move", "Move", "Set its place by hand (m)", () => review.startMove());
    if (verdict) button("reset", "Reset", "Forget what was decided about it", () => review.reset());
    const form = element("form", undefined, box, "row");
    const input = element("input", undefined, form);
    input.type = "text"; input.id = "class-name"; input.value = name;
    input.setAttribute("list", "class-names"); input.setAttribute("aria-label", "Class");
    const save = element("button", "Correct class", form);
    save.id = "save-class";
    form.onsubmit = (e) => { e.preventDefault(); if (input.value.trim()) { input.blur(); review.setClass(input.value.trim()); } };
    const noteForm = element("form", undefined, box, "row");
    const note = element("input", undefined, noteForm);
    note.type = "text"; note.id = "note"; note.placeholder = "Note"; note.value = verdict?.note ?? "";
    note.setAttribute("aria-label", "Note");
    element("button", "Keep note", noteForm).id = "save-note";
    noteForm.onsubmit = (e) => { e.preventDefault(); note.blur(); review.note(note.value); };
  }

  views(box) {
    const { views } = this.sign;
    if (!views.length) return;
    element("h3", `${views.length} view${views.length === 1 ? "" : "s"}`, box);
    const list = element("div", undefined, box);
    list.id = "views";
    // a long row of buttons tells nothing: at most some thirty, evenly chosen
    const step = Math.max(1, Math.ceil(views.length / 30));
    views.forEach((v, i) => {
      if (i % step && i !== this.view) return;
      const b = element("button", `${v.height_px.toFixed(0)} px`, list);
      b.type = "button";
      b.setAttribute("aria-pressed", String(i === this.view));
      b.title = [`frame ${v.frame} of ${v.camera}`, v.residual_px === null ? null : `residual ${v.residual_px} px`, v.used ? null : "not used"].filter(Boolean).join(", ");
      b.onclick = () => this.showView(i);
    });
  }

  figures(box, verdict) {
    element("h3", "Figures", box);
    const list = element("dl", undefined, box);
    const line = (term, value, title) => {
      const dt = element("dt", term, list);
      if (title) dt.title = title;
      element("dd", value, list);
    };
    const { sign } = this;
    if (verdict?.lon_deg !== undefined) line("set by hand", `${verdict.lat_deg.toFixed(7)}°, ${verdict.lon_deg.toFixed(7)}°`);
    if (sign.lat_deg !== null) line("computed at", `${sign.lat_deg.toFixed(7)}°, ${sign.lon_deg.toFixed(7)}°`, "latitude, longitude (WGS-84)");
    if (sign.height_m !== null) line("height", `${sign.height_m.toFixed(2)} m`, "above the ellipsoid");
    for (const field of this.app.overview.fields) {
      const value = sign.values[field.name];
      if (value === undefined || field.name === "id") continue;
      const unit = field.unit && field.unit !== "UTC" ? ` ${field.unit}` : "";
      const text = Array.isArray(value) ? value.join(", ") : String(value);
      line(field.name.replace(/_(m|deg|m2)$/, "").replace(/_/g, " "), text + unit, field.meaning);
    }
  }

  async showView(index) {
    const v = this.sign?.views[index];
    if (!v) return;
    this.view = index;
    for (const [i, b] of [...(this.app.byId("views")?.children ?? [])].entries()) b.setAttribute("aria-pressed", String(i === index));
    await this.app.player.showFrame(v.drive, v.camera, v.frame, v.t);
  }

  stepView(step) { if (this.sign?.views.length) this.showView(Math.min(Math.max(this.view + step, 0), this.sign.views.length - 1)); }
}
