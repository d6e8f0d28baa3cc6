// Choosing a class among all by picture and name.
import * as api from "./api.js";
import { words } from "./signs.js";

const flat = (text) => text.toLowerCase().replace(/[-_]+/g, " ").replace(/\s+/g, " ").trim();
const SHOWN = 400;

export class Picker {
  constructor(app) {
    this.app = app;
    const { byId } = app;
    this.dialog = byId("picker"); this.search = byId("picker-search"); this.list = byId("picker-list");
    this.at = 0; this.done = null;
    const own = new Set(app.state.signs.classes);
    this.classes = app.overview.known.map((c) => ({ ...c, words: words(c.name), text: flat(`${words(c.name)} ${c.name} ${c.codes}`), own: own.has(c.name) }));
    this.classes.sort((a, b) => b.own - a.own || a.words.localeCompare(b.words, "en", { numeric: true }));
    this.search.oninput = () => this.draw();
    this.search.onkeydown = (e) => this.key(e);
    this.list.onclick = (e) => { const item = e.target.closest("li"); if (item) this.take(item.dataset.name); };
    this.dialog.onclose = () => { const { done } = this; this.done = null; if (done) done(null); };
  }

  // the name of a class, null where none was chosen
  choose(current = "") {
    this.current = current;
    this.search.value = "";
    this.draw();
    this.dialog.showModal();
    this.search.focus();
    return new Promise((resolve) => { this.done = resolve; });
  }

  take(name) { const { done } = this; this.done = null; this.dialog.close(); if (done) done(name); }

  matches() {
    const wanted = flat(this.search.value);
    if (!wanted) return this.classes;
    const parts = wanted.split(" ");
    const rank = (c) => (flat(c.name) === wanted ? 0 : flat(c.words) === wanted ? 1 : flat(c.words).startsWith(wanted) ? 2 : flat(c.words).includes(wanted) ? 3 : 4);
    return this.classes.filter((c) => parts.every((part) => c.text.includes(part))).sort((a, b) => rank(a) - rank(b));
  }

  draw() {
    this.found = this.matches().slice(0, SHOWN);
    this.at = this.search.value ? 0 : Math.max(0, this.found.findIndex((c) => c.name === this.current));
    this.list.replaceChildren(...this.found.map((c, k) => {
      const item = c.item ??= this.item(c);
      item.id = `class-${k}`;
      return item;
    }));
    if (!this.found.length) {
      const none = document.createElement("li");
      none.className = "hint"; none.textContent = "No class of that name."; none.setAttribute("role", "option"); none.setAttribute("aria-disabled", "true");
      this.list.append(none);
    }
    this.mark();
  }

  // made once, so that a picture is asked for once
  item(c) {
    const item = document.createElement("li");
    item.dataset.name = c.name; item.title = [c.name, c.codes].filter(Boolean).join("\n");
    item.setAttribute("role", "option");
    const picture = document.createElement("img"), name = document.createElement("span");
    picture.src = api.face(c.name); picture.alt = ""; picture.loading = "lazy";
    name.textContent = c.words;
    if (c.codes) { const codes = document.createElement("small"); codes.textContent = c.codes; name.append(codes); }
    item.append(picture, name);
    return item;
  }

  mark() {
    [...this.list.children].forEach((item, k) => item.setAttribute("aria-selected", String(k === this.at)));
    const item = this.found.length ? this.list.children[this.at] : null;
    if (item) { this.search.setAttribute("aria-activedescendant", item.id); item.scrollIntoView({ block: "nearest" }); }
    else this.search.removeAttribute("aria-activedescendant");
  }

  key(e) {
    // what is typed here is none of the page's keys
    e.stopPropagation();
    const columns = Math.max(1, Math.floor(this.list.clientWidth / Math.max(1, this.list.firstElementChild?.offsetWidth ?? 1)));
    const step = { ArrowDown: columns, ArrowUp: -columns, ArrowRight: 1, ArrowLeft: -1 }[e.key];
    const sideways = e.key === "ArrowLeft" || e.key === "ArrowRight";
    if (step && !(sideways && this.search.value)) {
      e.preventDefault();
      this.at = Math.min(Math.max(this.at + step, 0), Math.max(0, this.found.length - 1));
      this.mark();
    } else if (e.key === "Enter") {
      e.preventDefault();
      const c = this.found[this.at];
      if (c) this.take(c.name);
    }
  }
}
