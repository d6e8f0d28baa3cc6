// The card of one sign. Text of the recording is only ever set as text.
import * as api from "./api.js";
import { classOf, facingOf, isGone, words } from "./signs.js";

const element = (tag, text, parent, className) => {
  const e = document.createElement(tag);
  if (text !== undefined && text !== null) e.textContent = text;
  if (className) e.className = className;
  if (parent) parent.append(e);
  return e;
};

const WORDS = {
  accept: "accepted", reject: "rejected", correct: "corrected", note: "note", reset: "reset", undo: "undone",
  add: "added", split: "split", merge: "made one with another",
};
const TIME = /^(\d{4}-\d\d-\d\d)T([\d:.]+)Z$/;
const EMPTY = "Click a sign, or press n for the first one. ? lists the keys.";

export class Card {
  constructor(app) {
    this.app = app; this.head = app.byId("head"); this.details = app.byId("details");
    this.sign = null; this.row = null; this.view = -1; this.boxes = new Set();
    this.seen = element("canvas");
    this.seen.id = "seen"; this.seen.width = this.seen.height = 128; this.seen.hidden = true;
    this.seen.setAttribute("role", "img");
  }

  async show(row) {
    if (row !== this.row) this.seen.hidden = true;
    this.row = row;
    if (row === null) {
      this.sign = null;
      this.boxes.clear();
      this.draw();
      // its boxes and ticks are nobody's now
      this.app.player.paint();
      this.app.player.marks();
      return;
    }
    let sign;
    try { sign = await api.json(`api/sign/${row}`); } catch (error) { this.app.hint(error.message); return; }
    // another sign may have been chosen in the meantime
    if (this.row !== row) return;
    this.take(sign);
    this.view = -1;
    this.draw();
    this.app.player.marks();
    if (sign.views.length) {
      // the largest that shows all of it
      const size = (v) => (v.height_px ?? 0) * (v.cut ? 0.01 : 1);
      const largest = sign.views.reduce((best, v, i) => (size(v) > size(sign.views[best]) ? i : best), 0);
      await this.showView(largest);
    }
  }

  take(sign) {
    this.sign = sign;
    this.boxes = new Set(sign.views.filter((v) => v.row !== undefined).map((v) => `${v.drive}/${v.row}`));
  }

  async refresh() {
    const { row } = this;
    if (row === null || !this.sign) return;
    const sign = await api.json(`api/sign/${row}`).catch(() => null);
    // what is being typed is not taken away
    const typed = document.activeElement;
    const busy = ["INPUT", "TEXTAREA"].includes(typed?.tagName) && this.details.contains(typed);
    if (!sign || this.row !== row) return;
    this.take(sign);
    if (!busy && !this.app.state.adding) this.draw();
    this.app.player.paint();
  }

  // what was seen beside what it was taken for, until the next of its frames
  closeUp(picture, [x0, y0, x1, y1], frame) {
    const { seen } = this;
    const side = 1.3 * Math.max(x1 - x0, y1 - y0);
    // beyond the edge of the frame there is nothing
    const at = (a, b, end) => Math.min(Math.max((a + b - side) / 2, 0), Math.max(end - side, 0));
    const ctx = seen.getContext("2d");
    ctx.clearRect(0, 0, seen.width, seen.height);
    ctx.imageSmoothingQuality = "high";
    ctx.drawImage(picture, at(x0, x1, picture.width), at(y0, y1, picture.height), side, side, 0, 0, seen.width, seen.height);
    seen.hidden = false;
    seen.setAttribute("aria-label", `As seen in frame ${frame}`);
  }

  className() { return this.row === null ? "" : classOf(this.app.state.signs, this.row); }

  draw() {
    const { signs } = this.app.state;
    const { sign, row, head, details } = this;
    const focus = document.activeElement?.id;
    head.replaceChildren();
    details.replaceChildren();
    if (row === null || !sign) { element("p", EMPTY, head, "hint"); return; }
    const verdict = signs.verdicts.get(row);
    const name = classOf(signs, row);
    const title = element("h2", undefined, head);
    const picture = element("img", undefined, title);
    picture.alt = "";
    picture.src = api.face(name);
    picture.onerror = () => picture.remove();
    title.append(this.seen);
    element("span", words(name), title);
    if (verdict?.status) element("span", verdict.status, title, `badge ${verdict.status}`);
    if (verdict?.disputed) element("span", "disputed", title, "badge rejected");
    element("div", sign.id, head, "hint");
    if (isGone(signs, row)) element("p", verdict?.into ? `It is one with ${verdict.into} now.` : "This sign was taken back.", head);
    else this.buttons(head, verdict);
    if (verdict?.disputed) element("p", `${verdict.reviewer || "Somebody"} decided otherwise than ${verdict.disputed.join(", ")}: see the review below. What you decide now settles it.`, head, "warn");
    this.views(details);
    this.corrections(details, verdict, name);
    this.figures(details, verdict);
    this.history(details);
    if (focus && !this.app.byId("picker").open) this.app.byId(focus)?.focus?.({ preventScroll: true });
  }

  button(parent, id, text, title, action) {
    const b = element("button", text, parent);
    b.type = "button"; b.id = id; b.title = title;
    b.onclick = action;
    return b;
  }

  buttons(box, verdict) {
    const { review } = this.app;
    const row = element("p", undefined, box, "row actions");
    this.button(row, "accept", "Accept", "The sign is right (a)", () => review.accept());
    this.button(row, "reject", "Reject", "There is no such sign (x)", () => review.reject());
    this.button(row, "class-button", "Class", "Correct the class (c)", () => review.chooseClass());
    this.button(row, "move", "Move", "Set its place by hand (m)", () => review.startMove());
    this.button(row, "turn", "Turn", "Set the way it faces (r)", () => review.startTurn());
    this.button(row, "merge", "Merge", "It is the same as another sign (j)", () => review.startMerge());
    if (this.sign.views.length > 1) this.button(row, "split", "Split", "Its views are of two signs (k)", () => review.startSplit());
    if (verdict) this.button(row, "reset", "Reset", "Forget what was decided about it", () => review.reset());
  }

  corrections(box, verdict) {
    const { review, state } = this.app;
    if (isGone(state.signs, this.row)) return;
    const line = (id, label, input, save, action) => {
      const form = element("form", undefined, box, "row");
      const tag = element("label", label, form);
      input.id = id;
      tag.append(input);
      element("button", save, form).id = `save-${id}`;
      form.onsubmit = (e) => { e.preventDefault(); input.blur(); action(input.value); };
    };
    const number = (value, decimals, low, high, step) => {
      const input = document.createElement("input");
      input.type = "number"; input.min = low; input.max = high; input.step = step;
      if (value !== undefined && value !== null && value === value) input.value = value.toFixed(decimals);
      return input;
    };
    element("h3", "Correct", box);
    const facing = facingOf(state.signs, this.row);
    line("facing", "Faces, ° from north", number(facing, 0, -360, 360, "any"), "Turn", (v) => { if (v !== "") review.turn(Number(v)); });
    const height = verdict?.height_above_road_m ?? this.sign.values.height_above_road_m;
    line("height", "Above the road, m", number(height, 2, -20, 50, "any"), "Raise", (v) => { if (v !== "") review.raise(Number(v)); });
    const note = document.createElement("input");
    note.type = "text"; note.value = verdict?.note ?? "";
    line("note", "Note", note, "Keep", (v) => review.note(v));
  }

  views(box) {
    const { views } = this.sign;
    if (!views.length) return;
    const { splitting } = this.app.state;
    element("h3", splitting ? "Views of the other sign" : `${views.length} view${views.length === 1 ? "" : "s"}`, box);
    const list = element("div", undefined, box);
    list.id = "views";
    // a long row of buttons tells nothing: at most some thirty, evenly chosen
    const step = splitting ? 1 : Math.max(1, Math.ceil(views.length / 30));
    const { drives } = this.app.overview;
    const order = views.map((_, i) => i).sort((a, b) => views[a].drive - views[b].drive || a - b);
    const several = views.some((v) => v.drive !== views[0].drive);
    let drive;
    order.forEach((i) => {
      const v = views[i];
      if (i % step && i !== this.view) return;
      if (several && v.drive !== drive) element("span", drives[v.drive], list);
      drive = v.drive;
      const b = element("button", v.height_px === undefined ? "click" : `${v.height_px.toFixed(0)} px`, list);
      b.type = "button"; b.dataset.view = i;
      const chosen = splitting ? splitting.has(i) : i === this.view;
      b.setAttribute("aria-pressed", String(chosen));
      b.setAttribute("aria-label", `View in frame ${v.frame}${several ? ` of ${drives[drive]}` : ""}, ${b.textContent}`);
      b.title = [`frame ${v.frame} of ${v.camera}`, v.residual_px === null || v.residual_px === undefined ? null : `residual ${v.residual_px} px`, v.used ? null : "not used"].filter(Boolean).join(", ");
      b.onclick = () => {
        if (splitting) {
          if (!splitting.delete(i)) splitting.add(i);
          b.setAttribute("aria-pressed", String(splitting.has(i)));
        }
        this.showView(i);
      };
    });
    if (!splitting) return;
    const row = element("p", undefined, box, "row");
    this.button(row, "save-split", "Make two signs", "Enter", () => this.app.review.save());
    this.button(row, "leave-split", "Cancel", "Esc", () => this.app.review.leave());
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
    const at = (p) => `${p.lat_deg.toFixed(7)}°, ${p.lon_deg.toFixed(7)}°`;
    const where = "latitude, longitude (WGS-84)";
    const now = verdict?.lon_deg === undefined ? "" : at(verdict);
    const computed = sign.lat_deg === null ? "" : at(sign);
    if (now && now !== computed) line(verdict.computed ? "now at" : "set by hand", now, where);
    if (computed) line(now && now !== computed ? "computed at" : "position", computed, where);
    if (sign.height_m !== null) line("height", `${sign.height_m.toFixed(2)} m`, "above the ellipsoid");
    for (const field of this.app.overview.fields) {
      const value = sign.values[field.name];
      if (value === undefined || field.name === "id") continue;
      const text = Array.isArray(value) ? value.join(", ") : String(value).replace(TIME, "$1 $2 UTC");
      const decided = this.decided(verdict, field.name);
      const other = decided !== undefined && decided !== value;
      if (other) line(`${field.title}, reviewed`, `${decided}${field.unit}`, field.meaning);
      line(field.title + (other ? ", computed" : ""), text + field.unit, field.meaning);
    }
  }

  // what the review says in place of a figure
  decided(verdict, name) {
    if (name === "class") return verdict?.class_name;
    if (name === "status") return verdict?.status || undefined;
    if (name !== "facing_deg" && name !== "height_above_road_m") return undefined;
    const value = verdict?.[name];
    return value === undefined ? value : Number(value.toFixed(name === "facing_deg" ? 1 : 2));
  }

  history(box) {
    const { sign } = this;
    if (!sign.history.length) return;
    element("h3", "Review", box);
    const list = element("ol", undefined, box);
    list.id = "history";
    for (const h of sign.history) {
      const item = element("li", undefined, list, h.stands ? "" : "undone");
      const what = h.kind === "merge" ? `one with ${h.other === sign.id ? h.sign : h.other}` : WORDS[h.kind];
      element("span", [what, h.class && words(h.class), h.note, h.reviewer, h.time.slice(0, 19).replace("T", " ") + " UTC"].filter(Boolean).join(", "), item);
      if (!h.stands || h.kind === "undo") continue;
      const b = element("button", "Undo", item);
      b.type = "button";
      b.setAttribute("aria-label", `Undo: ${what}`);
      b.onclick = () => this.app.review.undoAction(h.id);
    }
  }

  // the panel of a sign that is being added
  drawAdding() {
    const { adding } = this.app.state;
    const { review, picker } = this.app;
    const { head, details } = this;
    head.replaceChildren();
    details.replaceChildren();
    element("h2", "A sign that was missed", head);
    const found = adding.at || adding.preview;
    const text = adding.at ? "Placed on the map; drag the map, click again or use the arrows to correct it."
      : adding.trouble ? `No place yet: ${adding.trouble}.`
      : adding.preview ? `${adding.clicks.length} frames meet; the 95 % ellipse is ${adding.preview.major?.toFixed(1) ?? "?"} m.`
      : adding.clicks.length ? "Click it in a second frame, from further off or nearer."
      : "Click it on the map, or its middle in two or more frames of the video below.";
    const p = element("p", text, head);
    p.id = "adding"; p.setAttribute("role", "status");
    const row = element("p", undefined, head, "row actions");
    const name = this.button(row, "add-class", adding.name ? words(adding.name) : "Choose class", "", async () => {
      adding.name = await picker.choose(adding.name) ?? adding.name;
      if (this.app.state.adding === adding) { this.drawAdding(); this.app.byId("add-class").focus(); }
    });
    if (adding.name) { const picture = document.createElement("img"); picture.src = api.face(adding.name); picture.alt = ""; name.prepend(picture); }
    this.button(row, "save-add", "Add", "Enter", () => review.saveAdd()).disabled = !found;
    this.button(row, "leave-add", "Cancel", "Esc", () => review.leave());
  }

  async showView(index) {
    const v = this.sign?.views[index];
    if (!v) return;
    this.view = index;
    if (!this.app.state.splitting) {
      for (const b of this.app.byId("views")?.querySelectorAll("button") ?? []) b.setAttribute("aria-pressed", String(Number(b.dataset.view) === index));
    }
    await this.app.player.showFrame(v.drive, v.camera, v.frame, v.t);
  }

  stepView(step) { if (this.sign?.views.length) this.showView(Math.min(Math.max(this.view + step, 0), this.sign.views.length - 1)); }
}
