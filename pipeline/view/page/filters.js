// What is shown: classes, drives, confidence, review.
import { COLOURS, wordsApart } from "./signs.js";

export class Filters {
  constructor(app) {
    this.app = app;
    const { byId, state: { signs } } = app;
    this.classes = new Uint8Array(signs.classes.length).fill(1);
    this.drives = new Uint8Array(signs.drives.length).fill(1);
    const counts = new Uint32Array(signs.classes.length);
    for (let i = 0; i < signs.n; i++) counts[signs.class[i]]++;
    const order = [...counts.keys()].sort((a, b) => counts[b] - counts[a]);
    const said = wordsApart(signs.classes);
    this.ticks = order.map((k) => this.tick(byId("classes"), this.classes, k, said[k], signs.classes[k], counts[k], COLOURS[k % COLOURS.length]));
    const drives = signs.drives.map((name, k) => this.tick(byId("drives"), this.drives, k, name, name));
    byId("drive-box").hidden = signs.drives.length < 2;
    byId("confidence").oninput = (e) => {
      byId("confidence-value").textContent = Number(e.target.value).toFixed(2);
      app.refilter();
    };
    byId("review-filter").onchange = () => app.refilter();
    byId("order").onchange = () => { app.order = null; };
    byId("classes-all").onclick = () => this.setAll(this.ticks, true);
    byId("classes-none").onclick = () => this.setAll(this.ticks, false);
    byId("drives-all").onclick = () => this.setAll(drives, true);
    byId("drives-none").onclick = () => this.setAll(drives, false);
    byId("class-search").oninput = (e) => {
      const wanted = e.target.value.trim().toLowerCase();
      for (const label of this.ticks) label.hidden = !`${label.textContent} ${label.title}`.toLowerCase().includes(wanted);
      for (const label of this.ticks) label.style.display = label.hidden ? "none" : "";
    };
    byId("toggle-filters").onclick = () => this.toggle();
    // where it is narrow they would cover the map
    if (matchMedia("(max-width: 1000px)").matches) this.toggle();
  }

  tick(box, flags, k, text, title, count, colour) {
    const label = document.createElement("label");
    label.title = title;
    const input = document.createElement("input");
    input.type = "checkbox";
    input.checked = true;
    const take = () => { flags[k] = input.checked ? 1 : 0; };
    input.onchange = () => { take(); this.app.refilter(); };
    label.take = take;
    label.append(input);
    if (colour) { const dot = document.createElement("i"); dot.style.background = colour; label.append(dot); }
    const name = document.createElement("span");
    name.textContent = text;
    label.append(name);
    if (count !== undefined) { const small = document.createElement("small"); small.textContent = count; label.append(small); }
    box.append(label);
    return label;
  }

  // all that the search leaves
  setAll(labels, on) {
    for (const label of labels) {
      if (label.hidden) continue;
      label.firstChild.checked = on;
      label.take();
    }
    this.app.refilter();
  }

  toggle() {
    const box = this.app.byId("filters");
    box.hidden = !box.hidden;
    this.app.byId("toggle-filters").setAttribute("aria-expanded", String(!box.hidden));
  }

  values() {
    const { byId } = this.app;
    return {
      classes: this.classes, drives: this.drives.every(Boolean) ? null : this.drives,
      confidence: Number(byId("confidence").value), review: byId("review-filter").value,
    };
  }
}
